"""Least squares of photometric stereo on CUDA, which reads each image once."""

import warp as wp

from cvkern.kernels.warp import _native

OPTIONS = {"enable_backward": False, "fuse_fp": False}
KEPT = 9216  # values in the static shared memory of a block: six blocks fit into a multiprocessor
MOST_THREADS = 128


def threads_for(count: int) -> int:
    """Return the threads of a block that keeps `count` values a thread; 0 if that is too many."""
    return min(KEPT // count // 32 * 32, MOST_THREADS)


@_native.kernel("_photometry_cuda.cu", OPTIONS, KEPT=KEPT)
def solve_kept(
    images: wp.array3d[float],
    inverse: wp.array2d[float],
    lights: wp.array2d[float],
    mask: wp.array2d[wp.uint8],
    # outputs
    normals: wp.array3d[float],
    albedo: wp.array2d[float],
    residual: wp.array2d[float],
):
    """Forward to the native code."""
