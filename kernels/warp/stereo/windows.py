"""Matching by windows without a volume of costs, in Warp.

On the CPU a row at a time; on CUDA a tile at a time where it fits into shared memory, which needs
descriptors of at most 32 bits, else a strip of rows.
"""

import warp as wp

from cvkern.kernels.codes.stereo import Cost
from cvkern.kernels.warp._launch import launch_slabs, scratch, slabs

from . import _windows_cpu as cpu
from . import _windows_cuda as cuda
from .costs import _windows_cpu as window_cpu
from .costs import _windows_cuda as window_cuda
from .winners import pick, pick_right

_STRIP_BYTES = 64 << 20


def match_windows(
    left: wp.array,
    right: wp.array,
    first: int,
    count: int,
    cost: int,
    octets: int,
    radius_y: int,
    radius_x: int,
    subpixel: int,
    uniqueness: int,
    index: wp.array,
    disparity: wp.array,
    cost_of_index: wp.array,
    confidence: wp.array,
    right_index: wp.array,
) -> None:
    """Do `window_costs`, `pick` and `pick_right` a part at a time; sums must be below 65535."""
    height, width, channels = left.shape
    winners = [index, disparity, cost_of_index, confidence]
    options = [radius_y, radius_x, subpixel, uniqueness]
    if left.device.is_cuda:
        small = cost == Cost.CENSUS and octets <= 4 and channels == 1
        if small and cuda.words_for(count, radius_x):
            cuda.match_words(left, right, first, count, *options, winners, right_index)
            return
        strip = max(1, min(height, _STRIP_BYTES // (2 * width * count)))
        for top in range(0, height, strip):
            part = slice(top, min(top + strip, height))
            shape = (part.stop - top, width, count)
            costs = scratch("window.costs", shape, wp.uint16, left.device)
            window_cuda.window_costs(left, right, first, cost, radius_y, radius_x, costs, begin=top)
            pick(costs, first, subpixel, uniqueness, *(a[part] for a in winners))
            pick_right(costs, first, right_index[part])
        return
    parts = slabs(height, height * width * count)
    inner = window_cpu.slab_scratch(left, parts, count, cost, octets, radius_x, wp.uint16)
    turned = cpu.turned_scratch(width, count, parts, left.device)
    launch_slabs(
        cpu.match_windows(cost, left.dtype),
        height,
        parts,
        [left, right, first, count, octets, *options, *inner, *turned],
        [*winners, right_index],
    )
