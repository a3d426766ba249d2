"""Costs summed over windows, in Warp.

On the CPU a row at a time, many disparities in a vector; on CUDA a thread for several disparities.
"""

import warp as wp

from cvkern.kernels.warp._launch import launch_slabs, slabs

from . import _windows_cpu as window_cpu
from . import _windows_cuda as window_cuda


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
        window_cuda.window_costs(left, right, first, cost, radius_y, radius_x, costs)
        return
    height = left.shape[0]
    count = slabs(height, costs.size)
    sums = window_cpu.sums_dtype(left.dtype, costs.dtype)
    inner = window_cpu.slab_scratch(left, count, costs.shape[2], cost, octets, radius_x, sums)
    launch_slabs(
        window_cpu.window_costs(cost, left.dtype, costs.dtype),
        height,
        count,
        [left, right, first, octets, radius_y, radius_x, *inner],
        [costs],
    )
