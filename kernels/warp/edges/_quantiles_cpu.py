"""Histograms of gradient lengths on the CPU: one thread per slab of rows."""

import warp as wp

from cvkern.kernels.codes.edges import BINS
from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@_native.kernel("_quantiles_cpu.h", BINS=BINS)
def count_rows(
    slab: int,
    first: int,
    last: int,
    dy: wp.array2d[float],  # (H, W)
    dx: wp.array2d[float],  # (H, W)
    norm: int,
    level: int,
    shift: int,
    width: int,
    found: wp.array2d[int],  # (2, 2)
    # outputs
    counts: wp.array3d[int],  # (slabs, 2, BINS)
    most: wp.array[int],  # (slabs,)
): ...
