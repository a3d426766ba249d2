"""Matching by windows without a volume of costs, in Warp.

The costs are those of costs/windows.py, the winners those of winners.py. On the CPU a thread sums
one row at a time and picks its winners. On CUDA a block takes a tile of columns if it fits into
shared memory, which needs descriptors of at most 32 bits; otherwise the costs of a strip of rows
are stored.
"""

import warp as wp

from cvkern.kernels.codes.stereo import Cost, Rule, Winners
from cvkern.kernels.warp._launch import launch_slabs, scratch, slabs
from cvkern.kernels.warp._structs import struct_of

from . import _windows_cpu as cpu
from . import _windows_cuda as cuda
from ._winner import WinnerArrays, WinnerRule
from .costs import _windows_cuda as costs_cuda
from .costs._windows_cpu import windows_of
from .winners import pick, pick_right

_STRIP_BYTES = 64 << 20


def match_windows(
    left: wp.array,
    right: wp.array,
    count: int,
    cost: int,
    octets: int,
    radius_y: int,
    radius_x: int,
    rule: Rule,
    winners: Winners,
    right_index: wp.array,
) -> None:
    """Do `window_costs`, `pick` and `pick_right` part by part; sums must be below 65535."""
    height, width, channels = left.shape
    windows = windows_of(rule.first, octets, radius_y, radius_x)
    if left.device.is_cuda:
        small = cost == Cost.CENSUS and octets <= 4 and channels == 1
        if small and cuda.words_for(count, radius_x):
            cuda.match_words(left, right, count, windows, rule, winners, right_index)
            return
        strip = max(1, min(height, _STRIP_BYTES // (2 * width * count)))
        for top in range(0, height, strip):
            part = slice(top, min(top + strip, height))
            shape = (part.stop - top, width, count)
            costs = scratch("window.costs", shape, wp.uint16, left.device)
            costs_cuda.window_costs(
                left, right, rule.first, cost, radius_y, radius_x, costs, begin=top
            )
            pick(costs, rule, Winners(*(a[part] for a in winners)))
            pick_right(costs, rule.first, right_index[part])
        return
    parts = slabs(height, height * width * count)
    work = cpu.work_of(left, parts, count, cost, windows)
    launch_slabs(
        cpu.match_windows(cost, left.dtype),
        height,
        parts,
        [left, right, count, windows, struct_of(WinnerRule, rule), work],
        [struct_of(WinnerArrays, winners), right_index],
    )


def max_sum() -> int:
    """Return the largest sum of costs that a window may have."""
    return 2**16 - 2
