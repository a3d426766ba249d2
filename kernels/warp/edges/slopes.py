"""Smoothing that ignores masked pixels, in Warp; _slopes.py has the equations."""

import warp as wp

from cvkern.kernels.warp._launch import launch, launch_each

from . import _slopes as pixels


def cover(image: wp.array, mask: wp.array, covered: wp.array, weight: wp.array) -> None:
    """Set masked pixels to 0, and write the weights 1 and, for masked pixels, 0."""
    launch_each(pixels.cover, image.size, image.size, [image, mask], [covered, weight])


def recover(weight: wp.array, least: float, image: wp.array) -> None:
    """Divide smoothed pixels by the smoothed weight."""
    launch_each(pixels.recover, image.size, image.size, [weight, least], [image])


def recover_frame(
    rows: wp.array, columns: wp.array, cval: float, reach: int, image: wp.array
) -> None:
    """Divide pixels nearer to the border than `reach` by their weight, a product of two weights."""
    inputs = [rows, columns, cval]
    if image.device.is_cuda:
        launch(pixels.recover_frame, image.shape, inputs, [image])
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
    inputs = [smooth, weight, weight_dy, weight_dx, least]
    launch_each(pixels.recover_slopes, dy.size, dy.size, inputs, [dy, dx])


def confine(mask: wp.array, states: wp.array) -> None:
    """Remove edges where a pixel or one of its eight neighbours is masked."""
    launch_each(pixels.confine, states.size, states.size, [mask], [states])
