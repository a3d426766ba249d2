"""Matching by windows on the CPU: winners among the sums of costs/_sums_cpu.h, row by row.

The sums of a row are transposed in tiles, so that a vector holds 64 successive pixels when their
winners are picked, by the rule of _winner.h. The code is native, because both steps need vectors of
16-bit numbers and shuffles. One thread per slab of rows.
"""

from collections.abc import Iterable
from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import scratch

from ._winner import CURVES, WinnerArrays, WinnerRule
from .costs._windows_cpu import (
    LANES_OF,
    OPTIONS,
    Windows,
    constants,
    padded,
    slab_scratch,
)

_TILE = 32  # pixels and disparities that are transposed at a time


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
    work.line = line = line + _TILE * (line // _TILE % 2 == 0)
    size = _TILE * lanes + padded(count, wp.uint16) * line
    work.turned = scratch("window.turned", (slabs, size), wp.uint16, left.device)
    return work


def _by_turns(begins: Iterable[int], size: int, step: int) -> str:
    """Return the interleaved places of two vectors, `step` of each at a time.

    They are the `size` places that begin at each of `begins`.
    """
    pieces = (range(i, i + step) for begin in begins for i in range(begin, begin + size, step))
    return ", ".join(str(i + other) for piece in pieces for other in (0, _TILE) for i in piece)


@lru_cache
def match_windows(cost: int, pixel: Any) -> wp.Kernel:
    """Return the kernel that matches windows of images of this type, uint8 or uint64."""
    needs = {
        **constants(cost, pixel, wp.uint16),
        **CURVES,
        "WIDE": wp.int32,
        "TILE": _TILE,
        "LOW_HALVES": _by_turns(range(0, _TILE, 8), 4, 1),
        "HIGH_HALVES": _by_turns(range(4, _TILE, 8), 4, 1),
        "FIRST_BLOCKS": _by_turns([0], _TILE // 2, 8),
        "LAST_BLOCKS": _by_turns([_TILE // 2], _TILE // 2, 8),
    }

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
