"""Robust rules of photometric stereo on CUDA, whose values stay in shared memory."""

import warp as wp

from cvkern.kernels.codes import shading as codes
from cvkern.kernels.warp import _native

OPTIONS = {"enable_backward": False, "fuse_fp": True}
KEPT = 9216  # values of the threads of a block
MOST = 128  # images
MOST_THREADS = 128


def threads_for(count: int) -> int:
    """Return the threads of a block that keeps `count` values a thread; 0 if that is too many."""
    return min(KEPT // count // 32 * 32, MOST_THREADS) if count <= MOST else 0


@_native.kernel("_robust_cuda.cu", OPTIONS, KEPT=KEPT, LEFT_OUT=codes.LEFT_OUT)
def rank_kept(
    images: wp.array3d[float],
    scales: wp.array[float],
    mask: wp.array2d[wp.uint8],
    limit: float,
    # outputs
    ranks: wp.array3d[wp.uint16],
):
    """Forward to the native code."""


@_native.kernel(
    "_robust_cuda.cu",
    OPTIONS,
    KEPT=KEPT,
    LEFT_OUT=codes.LEFT_OUT,
    MOST=MOST,
    RIDGE=codes.RIDGE,
    FLOOR=codes.FLOOR,
    L1=int(codes.Photometric.L1),
    CONSENSUS=int(codes.Photometric.CONSENSUS),
)
def weigh_kept(
    images: wp.array3d[float],
    ranks: wp.array3d[wp.uint16],
    lights: wp.array2d[float],
    windows: wp.array2d[float],
    method: int,
    sweeps: int,
    # outputs
    normals: wp.array3d[float],
    albedo: wp.array2d[float],
    residual: wp.array2d[float],
):
    """Forward to the native code."""
