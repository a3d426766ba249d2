"""Matching by windows on the CPU: winners among the sums of costs/_sums_cpu.h, row by row.

The winners are those of _turned_cpu.h, 64 pixels at once. The code is native, because it needs
vectors of 16-bit numbers and shuffles. One thread per slab of rows.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import scratch

from . import _turned_cpu as turned
from ._winner import WinnerArrays, WinnerRule
from .costs._windows_cpu import (
    LANES_OF,
    OPTIONS,
    Windows,
    constants,
    padded,
    slab_scratch,
)


@wp.struct
class WindowWork:
    """The working memory of matching; each array has one row per slab."""

    lines: wp.array2d[wp.uint8]  # 2 rows of lines
    columns: wp.array2d[wp.uint16]  # (W + 2 radius_x) padded(D)
    turned: wp.array2d[wp.uint16]  # a tile, and padded(D) lines
    line: int  # length of a line


def work_of(left: wp.array, slabs: int, count: int, cost: int, windows: Windows) -> WindowWork:
    """Return the scratch memory of `slabs` slabs."""
    work = WindowWork()
    work.lines, work.columns = slab_scratch(left, slabs, count, cost, windows, wp.uint16)
    # Use an odd number of cache lines, or all disparities of a pixel would share a few of them.
    lanes = LANES_OF[wp.uint16]
    line = (-(-left.shape[1] // lanes) + 2) * lanes
    work.line = line = line + turned.TILE * (line // turned.TILE % 2 == 0)
    size = turned.TILE * lanes + padded(count, wp.uint16) * line
    work.turned = scratch("window.turned", (slabs, size), wp.uint16, left.device)
    return work


@lru_cache
def match_windows(cost: int, pixel: Any) -> wp.Kernel:
    """Return the kernel that matches windows of images of this type, uint8 or uint64."""
    needs = {**constants(cost, pixel, wp.uint16), **turned.CONSTANTS}

    @_native.kernel("_windows_cpu.h", OPTIONS, **needs)
    def match_windows(
        slab: int,
        first: int,
        last: int,
        left: wp.array3d[pixel],  # (H, W, C)
        right: wp.array3d[pixel],  # (H, W, C)
        count: int,
        windows: Windows,
        rule: WinnerRule,
        # scratch
        work: WindowWork,
        # outputs, (H, W)
        winners: WinnerArrays,
        right_index: wp.array2d[int],
    ): ...

    return match_windows
