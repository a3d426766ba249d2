"""Order statistics of gradient lengths on CUDA: histograms in shared memory; see _quantiles.py."""

import warp as wp

from cvkern.kernels.codes.edges import BINS, Norm
from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import BLOCK

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

FILE = "_quantiles_cuda.cu"
COUNTING = 528  # blocks of threads that count: some for each multiprocessor


@_native.kernel(FILE, BLOCK=BLOCK, BINS=BINS, L1=int(Norm.L1))
def count_pixels(
    dy: wp.array2d[float],  # (N H, W)
    dx: wp.array2d[float],  # (N H, W)
    norm: int,
    level: int,
    shift: int,
    width: int,
    found: wp.array2d[int],  # (2 N, 2)
    # outputs
    counts: wp.array3d[int],  # (N, 2, BINS)
    most: wp.array[int],  # (N,)
): ...


@_native.kernel(FILE, BLOCK=BLOCK, BINS=BINS)
def choose(
    counts: wp.array3d[int],  # (N, 2, BINS)
    level: int,
    width: int,
    # outputs
    found: wp.array2d[int],  # (2 N, 2)
): ...
