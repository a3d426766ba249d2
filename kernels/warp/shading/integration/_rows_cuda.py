"""Poisson's equation along rows on CUDA, in native code: a block has a row in shared memory."""

import warp as wp

from cvkern.kernels.warp import _native

OPTIONS = {"enable_backward": False, "fuse_fp": False}
LONGEST = 4096  # complex numbers of a row
THREADS = 512  # an eighth of these
MOST = 2**14  # blocks, which take rows in turns


@_native.kernel(
    "_rows_cuda.cu", OPTIONS, launch_bounds=(THREADS, 2), LONGEST=LONGEST, THREADS=THREADS
)
def solve_row(
    one: wp.array3d[float],
    waves: wp.array2d[float],
    quarters: wp.array2d[float],
    down: wp.array[float],
    along: wp.array[float],
    # outputs
    two: wp.array3d[float],
):
    """Forward to the native code."""
