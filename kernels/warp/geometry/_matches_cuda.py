"""The order of matches on CUDA: a block takes a pair of images.

The code (_matches_cuda.cu) is native: a block sorts in shared memory.
"""

import warp as wp

from cvkern.kernels.warp import _native

# Blocks are numbered along one axis.
wp.set_module_options({"enable_backward": False, "fuse_fp": False, "default_grid_stride": False})

THREADS = 256
_FILE = "_matches_cuda.cu"


@_native.kernel(_FILE, THREADS=THREADS, NEAR=2048)
def sort_pair(
    points0: wp.array2d[wp.float64],
    points1: wp.array2d[wp.float64],
    spans: wp.array2d[int],
    keys: wp.array[wp.uint64],
    # outputs
    order: wp.array[int],
    places: wp.array[int],
    counts: wp.array[int],
    boxes: wp.array3d[wp.float64],
): ...


@_native.kernel(_FILE, THREADS=THREADS)
def scale_pair(
    points0: wp.array2d[wp.float64],
    points1: wp.array2d[wp.float64],
    spans: wp.array2d[int],
    order: wp.array[int],
    counts: wp.array[int],
    scales: wp.array3d[wp.float64],
    lanes: int,
    # outputs
    matches: wp.array2d[float],
): ...
