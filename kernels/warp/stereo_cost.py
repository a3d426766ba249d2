"""Matching costs of a stereo pair, in Warp.

On the CPU a row at a time, many disparities in a vector; on CUDA a thread for several disparities.
"""

import warp as wp

from ..codes import Cost
from . import _census_blocks as census_blocks
from . import _census_rows as census_rows
from . import _correlation_rows as correlation_rows
from . import _window_blocks as window_blocks
from . import _window_rows as window_rows
from ._launch import launch_slabs, scratch, slabs


def census(
    image: wp.array, radius_y: int, radius_x: int, spacing: int, symmetric: bool, bits: wp.array
) -> None:
    """Census transform of each channel of uint8 or float32 (H, W, C), one bit a comparison."""
    if image.device.is_cuda:
        census_blocks.census(image, radius_y, radius_x, spacing, symmetric, bits)
        return
    height, width, step = image.shape
    size = 2 * radius_y * spacing + 1
    count = slabs(height, image.size * (2 * radius_y + 1) * (2 * radius_x + 1))
    # Elements are taken 64 at a time, whose windows reach so far behind the last of a row.
    shape = (count * size, (width + 2 * radius_x * spacing) * step + 64)
    lines = scratch("census.lines", shape, image.dtype, image.device)
    launch_slabs(
        census_rows.census[image.dtype],
        height,
        count,
        [image, radius_y, radius_x, spacing, int(symmetric), lines],
        [bits],
    )


def hamming(left: wp.array, right: wp.array, first: int, costs: wp.array) -> None:
    """Bits that differ between the pixels of a pair, for each disparity from `first` on."""
    if left.device.is_cuda:
        census_blocks.hamming(left, right, first, costs)
        return
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
    octets: int,
    radius_y: int,
    radius_x: int,
    costs: wp.array,
) -> None:
    """Sum a cost over windows of (H, W, C), for each disparity from `first` on.

    Pixels are uint8 or float32 with 1 octet, or uint64 for CENSUS with bits in the lowest octets
    only. Sums of integers must fit into uint8 or uint16 costs, or into int32 for float32 ones.
    """
    if left.device.is_cuda:
        window_blocks.window_costs(left, right, first, cost, radius_y, radius_x, costs)
        return
    height = left.shape[0]
    count = slabs(height, costs.size)
    sums = window_rows.sums_dtype(left.dtype, costs.dtype)
    inner = window_rows.slab_scratch(left, count, costs.shape[2], cost, octets, radius_x, sums)
    launch_slabs(
        window_rows.window_costs(cost, left.dtype, costs.dtype),
        height,
        count,
        [left, right, first, octets, radius_y, radius_x, *inner],
        [costs],
    )


def correlation(
    left: wp.array, right: wp.array, first: int, radius_y: int, radius_x: int, costs: wp.array
) -> None:
    """One less the correlation of windows of uint8 or float32 (H, W, C), each channel's mean apart.

    Sums of products of uint8 must fit into int32.
    """
    if left.device.is_cuda:
        window_blocks.correlation(left, right, first, radius_y, radius_x, costs)
        return
    height, width, channels = left.shape
    pixel, device = left.dtype, left.device
    wide = width + 2 * radius_x
    count = slabs(height, left.size * (2 * radius_y + 1))
    columns = scratch("zncc.columns", (count, 3 * wide + 4 * radius_x), wp.float64, device)
    sums, scales = [], []
    for name, image in (("left", left), ("right", right)):
        sums.append(scratch(f"zncc.{name}_sums", (height, channels, wide), wp.float64, device))
        scales.append(scratch(f"zncc.{name}_scales", (height, wide), wp.float64, device))
        launch_slabs(
            correlation_rows.moments(pixel),
            height,
            count,
            [image, radius_y, radius_x, columns],
            [sums[-1], scales[-1]],
        )
    count = slabs(height, costs.size)
    products = wp.float64 if pixel is wp.float32 else wp.int32
    inner = window_rows.slab_scratch(left, count, costs.shape[2], Cost.ZNCC, 1, radius_x, products)
    shape = (count, (1 + channels) * (width + window_rows.padded(costs.shape[2], products)))
    moments = scratch("zncc.moments", shape, wp.float64, device)
    launch_slabs(
        correlation_rows.correlation(pixel),
        height,
        count,
        [left, right, *sums, *scales, first, radius_y, radius_x, *inner, moments],
        [costs],
    )
