"""Levels of pyramids on CUDA, in native code: a warp goes down strips, a thread has four values."""

from collections.abc import Sequence

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import BLOCK

OPTIONS = {"enable_backward": False, "fuse_fp": False}
BLOCKS = 3  # blocks that a multiprocessor has at once
LANES = 30  # lanes of a warp that write two columns each
LONG = 8  # rows of a warp, at most
LEAST = 2**12  # warps, about, from which on they have more rows than one
MOST = 2**22  # threads, which take parts in turns
MANY = 2  # planes that a warp makes at once of an image
PART = 2  # columns of a thread: even
REST = 2**12  # pixels of a level that one block makes with all smaller ones, at most
MOST_LEVELS = 7  # levels of such a block, at most, and one that they are made from
THREADS = 2**10  # threads of such a block
FEWER = 2**9  # threads of one that adds bands up, so that each has 128 registers


def rows_each(planes: int, rows: int, columns: int) -> int:
    """Return the rows of a warp, so that there are enough warps of small levels too."""
    return min(max(planes * rows * -(-columns // (2 * LANES)) // LEAST, 1), LONG)


def rows_at_once(planes: int, rows: int, columns: int, blocks: int) -> int:
    """Return the rows of a warp, so that all warps run at once in so many blocks."""
    strips = -(-columns // (2 * LANES))
    return -(-rows // max(blocks * BLOCK // 32 // (planes * strips), 1))


def warps(planes: int, rows: int, columns: int, each: int) -> int:
    """Return the threads for planes of the smaller level, of which a warp does `each` rows."""
    strips = -(-columns // (2 * LANES))
    return threads(32 * planes * -(-rows // each) * strips)


def threads(count: int) -> int:
    """Return the threads of whole blocks."""
    return -(-min(count, MOST) // BLOCK) * BLOCK


@_native.kernel("_bands_cuda.cu", OPTIONS, launch_bounds=(BLOCK, BLOCKS), PART=PART, TOGETHER=1)
def reduce_strips(
    planes: int,
    src: wp.array3d[float],
    each: int,
    # outputs
    dst: wp.array3d[float],
):
    """Forward to the native code."""


@_native.kernel(
    "_bands_cuda.cu", OPTIONS, launch_bounds=(BLOCK, BLOCKS), PART=PART, MANY=MANY, TOGETHER=1
)
def begin_strips(
    logs: wp.array2d[float],
    lowest: float,
    step: float,
    sigma: float,
    slope: float,
    each: int,
    # outputs
    dst: wp.array3d[float],
):
    """Forward to the native code."""


@_native.kernel(
    "_bands_cuda.cu", OPTIONS, launch_bounds=(THREADS, 1), PART=PART, REST=REST, TOGETHER=1
)
def reduce_rest(
    planes: int,
    count: int,
    src: wp.array3d[float],
    # outputs
    a: wp.array3d[float],
    b: wp.array3d[float],
    c: wp.array3d[float],
    d: wp.array3d[float],
    e: wp.array3d[float],
    f: wp.array3d[float],
    g: wp.array3d[float],
):
    """Forward to the native code."""


@_native.kernel("_bands_cuda.cu", OPTIONS, launch_bounds=(BLOCK, 4), PART=PART, TOGETHER=2)
def collapse_four(
    fine: wp.array3d[float],
    coarse: wp.array3d[float],
    below: int,
    share: float,
    lowest: float,
    step: float,
    sigma: float,
    slope: float,
    # outputs
    out: wp.array3d[float],
):
    """Forward to the native code."""


@_native.kernel("_bands_cuda.cu", OPTIONS, launch_bounds=(FEWER, 1), PART=PART, TOGETHER=2)
def collapse_rest(
    count: int,
    lowest: float,
    step: float,
    slope: float,
    # outputs
    a: wp.array3d[float],
    b: wp.array3d[float],
    c: wp.array3d[float],
    d: wp.array3d[float],
    e: wp.array3d[float],
    f: wp.array3d[float],
    g: wp.array3d[float],
    h: wp.array3d[float],
):
    """Forward to the native code."""


def rest(levels: Sequence[wp.array]) -> int:
    """Return how many levels, the largest first, have launches of their own."""
    few = next((n for n, a in enumerate(levels) if a.shape[1] * a.shape[2] <= REST), len(levels))
    return max(few, len(levels) - MOST_LEVELS)


def filled(levels: Sequence[wp.array], count: int) -> list[wp.array]:
    """Return so many levels: the last one again in place of those that are not there."""
    return [*levels, *[levels[-1]] * (count - len(levels))]
