"""Costs summed over windows, in Warp.

The cost of pixel (y, x) and disparity d is a sum over a window and over the channels. It adds the
difference of the left image at (v, u) and the right image at (v, u - d): abs(a - b), (a - b)^2, the
dissimilarity of S. Birchfield and C. Tomasi (IEEE PAMI 20(4), 1998), or the number of differing
bits of a census. On the CPU a thread takes a slab of rows and keeps the sums down its columns. On
CUDA a first kernel sums down, a second one along; a thread computes several sums of one disparity.
"""

import warp as wp

from cvkern.kernels.warp._launch import launch_slabs, slabs

from . import _windows_cpu as cpu
from . import _windows_cuda as cuda


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
    """Sum a cost over windows of (H, W, C), for each disparity, beginning at `first`.

    Pixels are uint8 or float32 with 1 octet, or, for CENSUS, uint64 with bits only in the lowest
    octets. Sums of integers must fit into uint8 or uint16 costs, or into int32 for float32 costs.
    """
    if left.device.is_cuda:
        cuda.window_costs(left, right, first, cost, radius_y, radius_x, costs)
        return
    height = left.shape[0]
    count = slabs(height, costs.size)
    windows = cpu.windows_of(first, octets, radius_y, radius_x)
    sums = cpu.sums_dtype(left.dtype, costs.dtype)
    inner = cpu.slab_scratch(left, count, costs.shape[2], cost, windows, sums)
    launch_slabs(
        cpu.window_costs(cost, left.dtype, costs.dtype),
        height,
        count,
        [left, right, windows, *inner],
        [costs],
    )
