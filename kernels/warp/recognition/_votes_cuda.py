"""Votes and mean shift on CUDA: a block of threads a maximum, several lanes a word of a patch."""

import warp as wp

from cvkern.kernels.codes.recognition import DEEPEST, KERNEL_ONE, NOBODY
from cvkern.kernels.warp import _native

from ._space import Ballot, Cells

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

FILE = "_votes_cuda.cu"
THREADS = 128  # threads of a maximum
LANES = 8  # threads of a word of a patch
SELECTORS = 1024  # threads of the block that selects maxima


@_native.kernel(FILE, THREADS=THREADS, ONE=KERNEL_ONE, DEEPEST=DEEPEST)
def shift(
    cells: Cells,
    radius: int,
    scales: int,
    rounds: int,
    maxima: wp.array2d[int],  # (T, 4)
    # outputs
    modes: wp.array2d[int],  # (T, 4)
): ...


@_native.kernel(FILE, LANES=LANES)
def cast(
    ballot: Ballot,
    # outputs
    cells: wp.array[wp.uint64],  # (C,)
    votes: wp.array2d[int],  # (V, 4)
): ...


@wp.kernel
def split(
    cells: wp.array[wp.uint64],
    # outputs
    sums: wp.array[int],
    counts: wp.array[int],
):
    """Take the sum of the weights and the number of votes of a cell apart."""
    c = wp.tid()
    sums[c] = int(cells[c] & wp.uint64(0xFFFFFFFF))
    counts[c] = int(cells[c] >> wp.uint64(32))


@_native.kernel(FILE, THREADS=SELECTORS, NOBODY=NOBODY)
def select(
    maxima: wp.array2d[int],  # (T, 4)
    # outputs
    highest: wp.array2d[int],  # (M, 4)
): ...
