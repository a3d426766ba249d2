"""The census transform and the Hamming distance, in Warp."""

import warp as wp

from cvkern.kernels.warp._launch import launch_slabs, scratch, slabs

from . import _census_cpu as census_cpu
from . import _census_cuda as census_cuda


def census(
    image: wp.array, radius_y: int, radius_x: int, spacing: int, symmetric: bool, bits: wp.array
) -> None:
    """Census transform of each channel of uint8 or float32 (H, W, C), one bit a comparison."""
    if image.device.is_cuda:
        census_cuda.census(image, radius_y, radius_x, spacing, symmetric, bits)
        return
    height, width, step = image.shape
    size = 2 * radius_y * spacing + 1
    count = slabs(height, image.size * (2 * radius_y + 1) * (2 * radius_x + 1))
    # Elements are taken 64 at a time, whose windows reach so far behind the last of a row.
    shape = (count * size, (width + 2 * radius_x * spacing) * step + 64)
    lines = scratch("census.lines", shape, image.dtype, image.device)
    launch_slabs(
        census_cpu.census[image.dtype],
        height,
        count,
        [image, radius_y, radius_x, spacing, int(symmetric), lines],
        [bits],
    )


def hamming(left: wp.array, right: wp.array, first: int, costs: wp.array) -> None:
    """Bits that differ between the pixels of a pair, for each disparity from `first` on."""
    if left.device.is_cuda:
        census_cuda.hamming(left, right, first, costs)
        return
    height, width, step = left.shape
    count = slabs(height, costs.size)
    shape = (count * step, width + costs.shape[2] - 1)
    lines = scratch("hamming.lines", shape, wp.uint64, left.device)
    launch_slabs(census_cpu.hamming, height, count, [left, right, first, lines], [costs])
