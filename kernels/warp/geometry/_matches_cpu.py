"""The order of matches on the CPU: a thread takes a slab of pairs of images.

The code (_matches_cpu.h) is native because it shares the keys (_matches.h) with CUDA.
"""

import warp as wp

from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_FILE = "_matches_cpu.h"


@_native.each(_FILE, BUCKET_BITS=11)
def sort_pair(
    pair: int,
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


@_native.each(_FILE)
def scale_pair(
    pair: int,
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
