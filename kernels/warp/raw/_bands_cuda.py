"""Levels of pyramids on CUDA, in native code: a warp goes down strips, a thread has four values."""

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import BLOCK

OPTIONS = {"enable_backward": False, "fuse_fp": False}
LANES = 30  # lanes of a warp that write two columns each
LONG = 8  # rows of a warp, at most
LEAST = 2**12  # warps, about, from which on they have more rows than one
MOST = 2**22  # threads, which take parts in turns
MANY = 2  # planes that a warp makes at once of an image
PART = 2  # columns of a thread: even


def rows_each(planes: int, rows: int, columns: int) -> int:
    """Return the rows of a warp, so that there are enough warps of small levels too."""
    return min(max(planes * rows * -(-columns // (2 * LANES)) // LEAST, 1), LONG)


def warps(planes: int, rows: int, columns: int, each: int) -> int:
    """Return the threads for planes of the smaller level, of which a warp does `each` rows."""
    strips = -(-columns // (2 * LANES))
    return threads(32 * planes * -(-rows // each) * strips)


def threads(count: int) -> int:
    """Return the threads of whole blocks."""
    return -(-min(count, MOST) // BLOCK) * BLOCK


@_native.kernel("_bands_cuda.cu", OPTIONS, PART=PART)
def reduce_strips(
    planes: int,
    src: wp.array3d[float],
    each: int,
    # outputs
    dst: wp.array3d[float],
):
    """Forward to the native code."""


@_native.kernel(
    "_bands_cuda.cu", OPTIONS, launch_bounds=(BLOCK, 3), PART=PART, MANY=MANY, LONG=LONG
)
def begin_strips(
    logs: wp.array2d[float],
    lowest: float,
    step: float,
    sigma: float,
    slope: float,
    # outputs
    dst: wp.array3d[float],
):
    """Forward to the native code."""


@_native.kernel("_bands_cuda.cu", OPTIONS, PART=PART)
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
