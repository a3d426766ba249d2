"""Luminance and scaled colours on CUDA, in native code: four pixels a thread."""

import warp as wp

from cvkern.kernels.codes import raw as codes
from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import BLOCK

OPTIONS = {"enable_backward": False, "fuse_fp": False}
MOST = 2**18  # threads, which take pixels in turns
SUMS = {"STEPS": f"{codes.STEPS}.0f", "SLOTS": codes.SLOTS}
NAMES = {
    **dict(zip(("RED", "GREEN", "BLUE"), (f"{w!r}f" for w in codes.LUMINANCE), strict=True)),
    "UNSEEN": f"{codes.UNSEEN!r}f",
}


def threads(count: int) -> int:
    """Return the threads of whole blocks for so many groups of pixels."""
    return -(-min(count, MOST) // BLOCK) * BLOCK


@_native.kernel("_tone_cuda.cu", OPTIONS, **NAMES, **SUMS)
def survey_four(
    radiance: wp.array3d[float],
    # outputs
    logs: wp.array2d[float],
    sums: wp.array2d[wp.int64],
):
    """Forward to the native code."""


@_native.kernel("_tone_cuda.cu", OPTIONS, **NAMES, **SUMS)
def show_four(
    radiance: wp.array3d[float],
    one: wp.array2d[float],
    own: float,
    two: wp.array2d[float],
    other: float,
    offset: float,
    # outputs
    out: wp.array3d[float],
):
    """Forward to the native code."""
