"""Multi-band blending: Laplacian bands of images and their weighted mean, in Warp.

The Taichi set has the equations. Colours are planes (C, H, W). One thread computes one pixel.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.panorama import BLEND_TAPS, Part
from cvkern.kernels.warp._launch import launch_each

OPTIONS = {"enable_backward": False, "fuse_fp": False}
wp.set_module_options(OPTIONS)

vec5 = wp.types.vector(5, wp.float32)
RIM, SIDE, MIDDLE = (wp.constant(t) for t in BLEND_TAPS[:3])


def reduce(src: wp.array, dst: wp.array) -> None:
    """Smooth planes and keep every second row and column; one thread a pixel of the result."""
    launch_each(_reduce, dst.size, dst.size * 8, [src], [dst])


def add_band(
    fine: wp.array,
    coarse: wp.array,
    last: int,
    top: int,
    left: int,
    totals: wp.array,
    sums: wp.array,
) -> None:
    """Add weights times (fine - enlarged coarse) to a part of the totals; one thread a pixel.

    The plane of `fine` behind the colours has the weights, which are added to the sums. The `last`
    band is the fine image itself.
    """
    inputs, pixels = [fine, coarse, last, top, left], fine.shape[1] * fine.shape[2]
    launch_each(_add_band, pixels, pixels * 8, inputs, [totals, sums])


def collapse(sums: wp.array, coarse: wp.array, last: int, values: wp.array) -> None:
    """Divide totals by their sums; add the enlarged coarse image, except in the `last` band.

    `values` holds the totals before and the image afterwards. One thread a pixel.
    """
    launch_each(_collapse, sums.size, sums.size * 8, [sums, coarse, last], [values])


def finish(
    values: wp.array,
    labels: wp.array,
    high: float,
    part: Part,
    image: wp.array,
    mask: wp.array,
) -> None:
    """Write a part of a tile to an image; one thread a pixel.

    A positive `high` is the largest value, and values are rounded. Pixels without an image are 0.
    """
    moved = Places()
    moved.top, moved.left, moved.row, moved.column, _, moved.columns = part
    inputs = [values, labels, high, moved]
    count = part.rows * part.columns
    launch_each(finish_kernel(image.dtype), count, count * 4, inputs, [image, mask])


@wp.struct
class Places:
    """Where a part of a tile begins, in the tile and in the image; see `codes.panorama.Part`."""

    top: int
    left: int
    row: int
    column: int
    columns: int


@wp.func
def tap(t: int) -> float:
    """Return tap -2 to 2 of the filter."""
    if t == 0:
        return MIDDLE
    if t == -1 or t == 1:
        return SIDE
    return RIM


@wp.kernel
def _reduce(
    stride: int,
    first: int,
    last: int,
    src: wp.array3d[float],  # (C, H, W)
    # outputs
    dst: wp.array3d[float],  # (C, H / 2, W / 2)
):
    height = dst.shape[1]
    width = dst.shape[2]
    for item in range(first + wp.tid(), last, stride):
        line = item // width
        j = item - line * width
        c = line // height
        i = line - c * height
        total = float(0.0)
        for s in range(5):
            y = wp.clamp(2 * i + s - 2, 0, src.shape[1] - 1)
            along = float(0.0)
            for t in range(5):
                x = wp.clamp(2 * j + t - 2, 0, src.shape[2] - 1)
                along += tap(t - 2) * src[c, y, x]
            total += tap(s - 2) * along
        dst[c, i, j] = total


@wp.func
def along_row(coarse: wp.array3d[float], c: int, i: int, x: int) -> float:
    """Return column x of row i of the coarse image, enlarged along the row."""
    width = coarse.shape[2]
    j = x // 2
    here = coarse[c, i, j]
    after = coarse[c, i, wp.min(j + 1, width - 1)]
    if x - 2 * j == 1:
        return 0.5 * here + 0.5 * after
    before = coarse[c, i, wp.max(j - 1, 0)]
    return 0.125 * before + 0.75 * here + 0.125 * after


@wp.func
def enlarged(coarse: wp.array3d[float], c: int, y: int, x: int) -> float:
    """Return a pixel of the coarse image at twice its size."""
    height = coarse.shape[1]
    i = y // 2
    here = along_row(coarse, c, i, x)
    after = along_row(coarse, c, wp.min(i + 1, height - 1), x)
    if y - 2 * i == 1:
        return 0.5 * here + 0.5 * after
    before = along_row(coarse, c, wp.max(i - 1, 0), x)
    return 0.125 * before + 0.75 * here + 0.125 * after


@wp.kernel
def _add_band(
    stride: int,
    first: int,
    last_item: int,
    fine: wp.array3d[float],  # (C + 1, h, w)
    coarse: wp.array3d[float],  # (C + 1, h / 2, w / 2)
    last: int,
    top: int,
    left: int,
    # outputs
    totals: wp.array3d[float],  # (C, H, W)
    sums: wp.array2d[float],  # (H, W)
):
    width = fine.shape[2]
    channels = totals.shape[0]
    for item in range(first + wp.tid(), last_item, stride):
        i = item // width
        j = item - i * width
        weight = fine[channels, i, j]
        if weight > 0.0:
            sums[top + i, left + j] += weight
            for c in range(channels):
                band = fine[c, i, j]
                if last == 0:
                    band -= enlarged(coarse, c, i, j)
                totals[c, top + i, left + j] += weight * band


@wp.kernel
def _collapse(
    stride: int,
    first: int,
    last_item: int,
    sums: wp.array2d[float],  # (H, W)
    coarse: wp.array3d[float],  # (C, H / 2, W / 2)
    last: int,
    # outputs
    values: wp.array3d[float],  # (C, H, W)
):
    width = sums.shape[1]
    for item in range(first + wp.tid(), last_item, stride):
        i = item // width
        j = item - i * width
        weight = sums[i, j]
        for c in range(values.shape[0]):
            value = float(0.0)
            if weight > 0.0:
                value = values[c, i, j] / weight
            if last == 0:
                value += enlarged(coarse, c, i, j)
            values[c, i, j] = value


@lru_cache
def finish_kernel(scalar: Any) -> wp.Kernel:
    """Make the kernel that writes arrays of `scalar`."""

    @wp.kernel(module="unique", module_options=OPTIONS)
    def finish_pixels(
        stride: int,
        first: int,
        last: int,
        values: wp.array3d[float],  # (C, h, w)
        labels: wp.array2d[int],  # (h, w)
        high: float,
        part: Places,
        # outputs
        image: wp.array3d[scalar],  # (H, W, C)
        mask: wp.array2d[wp.uint8],  # (H, W)
    ):
        for item in range(first + wp.tid(), last, stride):
            i = item // part.columns
            j = item - i * part.columns
            there = labels[part.top + i, part.left + j] >= 0
            mask[part.row + i, part.column + j] = wp.where(there, wp.uint8(1), wp.uint8(0))
            for c in range(image.shape[2]):
                value = float(0.0)
                if there:
                    value = values[c, part.top + i, part.left + j]
                    if high > 0.0:
                        value = wp.floor(wp.clamp(value, 0.0, high) + 0.5)
                image[part.row + i, part.column + j, c] = scalar(value)

    return finish_pixels
