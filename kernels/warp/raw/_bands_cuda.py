"""Levels of pyramids on CUDA, in native code: a warp goes down strips, a thread has four values."""

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import BLOCK

OPTIONS = {"enable_backward": False, "fuse_fp": False}
LANES, ROWS = 30, 2  # lanes of a warp that write two columns each, and rows that they write
LONG = 8  # the same of an image that is remapped
MOST = 2**22  # threads, which take parts in turns
MANY = 4  # planes that a warp makes at once of an image
PART = 2  # columns of a thread: even


def warps(planes: int, rows: int, columns: int, each: int = ROWS) -> int:
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
    # outputs
    dst: wp.array3d[float],
):
    """Forward to the native code."""


@_native.kernel(
    "_bands_cuda.cu", OPTIONS, launch_bounds=(BLOCK, 2), PART=PART, MANY=MANY, LONG=LONG
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
