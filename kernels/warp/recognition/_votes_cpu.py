"""Votes and mean shift on the CPU, 16 of them at a time.

7 million votes are counted in 14 ms of one core, 2.4 million of them listed in 40, and 500 maxima
moved in 21. One vote at a time in Warp takes 3 times as long.
"""

import warp as wp

from cvkern.kernels.codes.recognition import DEEPEST, KERNEL_ONE
from cvkern.kernels.warp import _native

from ._space import Ballot, Cells

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

FILE = "_votes_cpu.h"
LANES = 16


@_native.func_native(FILE)
def lay_level(level: int, ballot: Ballot, words: wp.array3d[int], live: wp.array3d[int]): ...


@_native.func_native(FILE, LANES=LANES)
def cast_band(
    number: int,
    ballot: Ballot,
    bands: wp.array2d[int],
    words: wp.array3d[int],
    live: wp.array3d[int],
    cells: wp.array[wp.uint64],
    sums: wp.array[int],
    counts: wp.array[int],
    votes: wp.array2d[int],
): ...


@wp.kernel
def lay(
    slab: int,
    first: int,
    last: int,
    ballot: Ballot,
    # outputs
    words: wp.array3d[int],  # (L, S, 3 (K + 1))
    live: wp.array3d[int],  # (L, 4, O + LANES)
):
    for level in range(first, last):
        lay_level(level, ballot, words, live)


@wp.kernel
def cast(
    slab: int,
    first: int,
    last: int,
    ballot: Ballot,
    bands: wp.array2d[int],  # (B, 3): bin, first row of cells, row behind the last
    words: wp.array3d[int],  # (L, S, 3 (K + 1))
    live: wp.array3d[int],  # (L, 4, O + LANES)
    cells: wp.array[wp.uint64],  # (C + B LANES,): work space
    # outputs
    sums: wp.array[int],
    counts: wp.array[int],
    votes: wp.array2d[int],  # (V, 4)
):
    for number in range(first, last):
        cast_band(number, ballot, bands, words, live, cells, sums, counts, votes)


@_native.func_native(FILE, LANES=LANES, ONE=KERNEL_ONE, DEEPEST=DEEPEST)
def shift_mode(
    t: int,
    cells: Cells,
    radius: int,
    scales: int,
    rounds: int,
    maxima: wp.array2d[int],
    modes: wp.array2d[int],
): ...


@wp.kernel
def shift(
    slab: int,
    first: int,
    last: int,
    cells: Cells,
    radius: int,
    scales: int,
    rounds: int,
    maxima: wp.array2d[int],  # (T, 4)
    # outputs
    modes: wp.array2d[int],  # (T, 4)
):
    for t in range(first, last):
        shift_mode(t, cells, radius, scales, rounds, maxima, modes)
