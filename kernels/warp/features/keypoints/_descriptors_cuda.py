"""Orientations and descriptors on CUDA: a block of threads a point, histograms in shared memory.

The Taichi set has the rules; sums are integers, so that atomics give the same result in any order.
Plain Warp takes a thread a row, and adds to histograms in global memory.
"""

import warp as wp

from cvkern.kernels.warp import _native

from ._descriptors_cpu import DESCRIBE, ORIENT

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

FILE = "_descriptors_cuda.cu"
THREADS = 128  # threads of a block; a descriptor has as many numbers


@_native.kernel(FILE, **ORIENT)
def orient(
    octaves: wp.array2d[wp.int64],  # (O, 4)
    windows: wp.array2d[int],  # (N, 5)
    spreads: wp.array[float],
    one: float,
    # outputs
    angles: wp.array2d[float],  # (N, PEAKS)
    counts: wp.array[int],
): ...


@_native.kernel(FILE, **DESCRIBE)
def describe(
    octaves: wp.array2d[wp.int64],
    windows: wp.array2d[int],
    turns: wp.array2d[float],  # (N, 4): cosine and sine over a cell's side, angle, spread
    one: float,
    root: int,
    # outputs
    descriptors: wp.array2d[wp.uint8],  # (N, 128)
): ...
