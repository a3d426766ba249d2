"""Votes and mean shift on the CPU, 16 of them at a time.

3.5 million votes are cast in 66 ms of one core, and 500 maxima moved in 15; one vote at a time in
Warp, in 215 and 43 ms.
"""

import warp as wp

from cvkern.kernels.codes.recognition import DEEPEST, KERNEL_ONE
from cvkern.kernels.warp import _native

from ._space import Ballot, Cells

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

FILE = "_votes_cpu.h"
LANES = 16


@_native.kernel(FILE, LANES=LANES)
def cast_bins(
    slab: int,
    first: int,
    last: int,
    ballot: Ballot,
    firsts: wp.array2d[int],  # (slabs, K + 1): work space
    live: wp.array3d[int],  # (slabs, 5, O + LANES): work space
    # outputs
    sums: wp.array[int],
    counts: wp.array[int],
    votes: wp.array2d[int],  # (V, 4)
    sources: wp.array2d[int],  # (V, 2)
): ...


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
