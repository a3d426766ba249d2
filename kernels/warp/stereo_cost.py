"""Matching costs of a stereo pair, in Warp.

On the CPU a row at a time, many disparities in a vector; on CUDA a thread for several disparities.
"""

import warp as wp

from ..codes import Cost
from . import _census_rows as census_rows
from . import _window_rows as window_rows
from ._launch import launch_slabs, scratch, slabs


def census(image: wp.array, radius_y: int, radius_x: int, symmetric: bool, bits: wp.array) -> None:
    """Census transform of each channel of uint8 or float32 (H, W, C), one bit a comparison."""
    height, width, step = image.shape
    size = 2 * radius_y + 1
    count = slabs(height, image.size * size)
    # Elements are taken 64 at a time, whose windows reach so far behind the last of a row.
    shape = (count * size, (width + 2 * radius_x) * step + 64)
    lines = scratch("census.lines", shape, image.dtype, image.device)
    launch_slabs(
        census_rows.census[image.dtype],
        height,
        count,
        [image, radius_y, radius_x, int(symmetric), lines],
        [bits],
    )


def hamming(left: wp.array, right: wp.array, first: int, costs: wp.array) -> None:
    """Bits that differ between the pixels of a pair, for each disparity from `first` on."""
    height, width, step = left.shape
    count = slabs(height, costs.size)
    shape = (count * step, width + costs.shape[2] - 1)
    lines = scratch("hamming.lines", shape, wp.uint64, left.device)
    launch_slabs(census_rows.hamming, height, count, [left, right, first, lines], [costs])


def window_costs(
    left: wp.array,
    right: wp.array,
    first: int,
    cost: int,
    radius_y: int,
    radius_x: int,
    costs: wp.array,
) -> None:
    """Sum a cost over windows of uint8 or float32 (H, W, C), for each disparity from `first` on.

    Sums of uint8 must fit into `costs` of uint8 or uint16, or into int32 for `costs` of float32.
    """
    pixel, device = left.dtype, left.device
    height, width, channels = left.shape
    count = slabs(height, costs.size)
    sums = window_rows.sums_dtype(pixel, costs.dtype)
    reach = -(-costs.shape[2] // window_rows.lanes(sums)) * window_rows.lanes(sums)
    wide = width + 2 * radius_x
    planes = channels * (3 if cost == Cost.BIRCHFIELD_TOMASI else 1)
    lines = scratch("window.lines", (count, 2 * planes * (2 * wide + reach + 4)), pixel, device)
    columns = scratch("window.columns", (count, wide * reach), sums, device)
    launch_slabs(
        window_rows.window_costs(cost, pixel, costs.dtype),
        height,
        count,
        [left, right, first, radius_y, radius_x, lines, columns],
        [costs],
    )
