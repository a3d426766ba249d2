"""Smoothing that ignores masked pixels, in Warp; _slopes.py has the equations.

Images are (H, W), or (N, H, W) of a stack, whose rows kernels see as those of one image.
"""

import warp as wp

from cvkern.kernels.warp._launch import launch, launch_each, scratch

from . import _slopes as pixels
from ._stacks import tall


def cover(image: wp.array, mask: wp.array | None, covered: wp.array, weight: wp.array) -> None:
    """Set masked pixels, if any, to 0, and write the weights 1 and, for masked pixels, 0."""
    masked = mask is not None
    given = (
        tall(mask, wp.uint8) if masked else scratch("cover.mask", (1, 1), wp.uint8, image.device)
    )
    inputs = [tall(image), masked, given]
    launch_each(pixels.cover, image.size, image.size, inputs, [tall(covered), tall(weight)])


def recover(weight: wp.array, least: float, image: wp.array) -> None:
    """Divide smoothed pixels by the smoothed weight."""
    inputs = [tall(weight), least]
    launch_each(pixels.recover, image.size, image.size, inputs, [tall(image)])


def recover_frame(
    rows: wp.array, columns: wp.array, cval: float, reach: int, image: wp.array
) -> None:
    """Divide pixels nearer to the border than `reach` by their weight, a product of two weights."""
    inputs = [rows, columns, cval]
    image = tall(image)
    if image.device.is_cuda:
        height, width = rows.shape[0], image.shape[1]
        outer, beside = min(2 * reach, height), min(2 * reach, width)
        pixels_of_frame = outer * width + (height - outer) * beside
        count = image.shape[0] // height * pixels_of_frame
        launch(pixels.recover_frame, count, [*inputs, reach, outer, beside], [image])
        return
    height, width = image.shape
    elements = 2 * reach * (height + width)
    launch_each(pixels.recover_frame_rows, height, elements, [*inputs, reach], [image])


def recover_slopes(
    smooth: wp.array,
    weight: wp.array,
    weight_dy: wp.array,
    weight_dx: wp.array,
    least: float,
    dy: wp.array,
    dx: wp.array,
) -> None:
    """Differentiate the quotient of smoothed pixels and their weights."""
    inputs = [*map(tall, (smooth, weight, weight_dy, weight_dx)), least]
    launch_each(pixels.recover_slopes, dy.size, dy.size, inputs, [tall(dy), tall(dx)])


def confine(mask: wp.array, states: wp.array) -> None:
    """Remove edges where a pixel or one of its eight neighbours is masked."""
    inputs = [tall(mask, wp.uint8), states.shape[-2]]
    launch_each(pixels.confine, states.size, states.size, inputs, [tall(states, wp.uint8)])
