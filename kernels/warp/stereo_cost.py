"""Matching costs of a stereo pair, in Warp.

On the CPU a row at a time, many disparities in a vector; on CUDA a thread for several disparities.
"""

import warp as wp

from . import _census_rows as census_rows
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
