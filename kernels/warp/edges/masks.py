"""Thinning and hysteresis, in Warp.

Thinning keeps the maxima along the gradient; hysteresis keeps weak pixels that are connected with a
strong one (Canny, TPAMI 1986). On the CPU, thinning works row by row and hysteresis is a flood
fill, both in slabs of rows. On CUDA a thread thins a strip of columns, and hysteresis is a
union-find over all pixels at once.

Images are (H, W), or (N, H, W) of a stack. On CUDA all images are thinned in one launch.
"""

import warp as wp

from cvkern.kernels.warp._lanes_cpu import WIDE, f32_wide, padded, vectors
from cvkern.kernels.warp._launch import launch, launch_slabs, scratch, slabs, view

from . import _masks_cpu as cpu
from . import _masks_cuda as cuda
from ._stacks import tall


def thin_sobel(
    src: wp.array, border: int, cval: float, norm: int, low: float, high: float, states: wp.array
) -> None:
    """Apply Sobel's kernels, non-maximum suppression, and both thresholds to a uint8 image."""
    if src.device.is_cuda:
        strips, height = _strips(src)
        src, states = (tall(a, wp.uint8) for a in (src, states))
        inputs = [src, height, _in_words(src, states), border, cval, norm, low, high]
        launch(cuda.thin_sobel, strips, inputs, [states])
        return
    if src.ndim == 3:
        for n in range(src.shape[0]):
            thin_sobel(src[n], border, cval, norm, low, high, states[n])
        return
    wide = vectors(padded(src, "thin.src", WIDE), cpu.u8_wide)
    count = slabs(src.shape[0], src.size)
    inputs = [wide, border, cval, norm, low, high, *_lines(src, cpu.LINES * count)]
    launch_slabs(cpu.thin_sobel, src.shape[0], count, inputs, [states])


def thin(
    dy: wp.array, dx: wp.array, norm: int, rule: int, limits: wp.array, states: wp.array
) -> None:
    """Apply non-maximum suppression and both thresholds to a gradient.

    There are two limits for all images, or for each.
    """
    if dy.device.is_cuda:
        strips, height = _strips(dy)
        dy, dx, states = tall(dy), tall(dx), tall(states, wp.uint8)
        inputs = [dy, dx, height, _in_words(states), norm, rule, limits]
        launch(cuda.thin, strips, inputs, [states])
        return
    if dy.ndim == 3:
        for n in range(dy.shape[0]):
            at = min(2 * n, limits.shape[0] - 2)
            thin(dy[n], dx[n], norm, rule, limits[at : at + 2], states[n])
        return
    wide = [vectors(padded(a, f"thin.{i}", WIDE), f32_wide) for i, a in enumerate((dy, dx))]
    count = slabs(dy.shape[0], dy.size)
    inputs = [*wide, norm, rule, limits, *_lines(dy, cpu.MEASURE_LINES * count)]
    launch_slabs(cpu.thin, dy.shape[0], count, inputs, [states])


def hysteresis(states: wp.array, mask: wp.array) -> None:
    """Keep strong pixels, and the weak ones connected with them."""
    if states.ndim == 3 and not states.device.is_cuda:
        for n in range(states.shape[0]):
            hysteresis(states[n], mask[n])
        return
    height, width = states.shape[-2:]
    size = states.size
    states, mask = (view(a, wp.uint8, (size,)) for a in (states, mask))
    if states.device.is_cuda:
        words, mask_words = _words(states, mask)
        parents = scratch("hysteresis.parents", (size + 1,), wp.int32, states.device)
        eights = -(-size // 8)
        launch(cuda.plant, eights, [states, words], [parents, mask, mask_words])
        launch(cuda.merge, size, [states, height, width], [parents])
        launch(cuda.select, eights, [states, words, parents], [mask])
        return
    count = slabs(height, size)
    if count > 1:  # edges cluster in parts of an image; smaller slabs balance the threads
        count = min(4 * count, height)
    # A pixel is pushed once; the place above the top of the stack is written to as well.
    stack = scratch("hysteresis.stack", (size + count,), wp.vec2i, states.device)
    launch_slabs(cpu.flood_slab, height, count, [states, width, stack], [mask])
    if count > 1:
        launch(cpu.flood_seams, 1, [count, states, width, stack], [mask])


def _strips(image: wp.array) -> tuple[tuple[int, int], int]:
    """Return the numbers of strips down and across all images, and the rows of one."""
    images, height, width = (1, *image.shape)[-3:]
    return (images * -(-height // cuda.ROWS), -(-width // cuda.QUAD)), height


def _in_words(*images: wp.array) -> bool:
    """Tell whether every row of the images consists of aligned words of four bytes."""
    return all(a.shape[1] % 4 == 0 and a.ptr % 4 == 0 for a in images)


def _words(*flats: wp.array) -> list[wp.array]:
    """View bytes as words of eight, without the remainder; empty if they are not aligned."""
    count = flats[0].size // 8 if all(a.ptr % 8 == 0 for a in flats) else 0
    return [view(a, wp.uint64, (count,)) for a in flats]


def _lines(image: wp.array, count: int) -> list[wp.array]:
    """Return scratch lines of the image's width plus margins of one, as floats and as vectors."""
    shape = (count, max(image.shape[1], WIDE) + 2)
    lines = scratch("thin.lines", shape, wp.float32, image.device)
    return [lines, vectors(lines, f32_wide)]
