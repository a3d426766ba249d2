"""Smoothing of the levels of a scale space on the CPU, two rows at a time."""

import warp as wp

from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@_native.kernel("_smoothing_cpu.h")
def smooth_rows(
    slab: int,
    first: int,
    last: int,
    src: wp.array2d[float],
    taps: wp.array[float],
    margin: int,
    # scratch
    lines: wp.array2d[float],  # (2 slabs, margin + W + margin)
    # outputs
    dst: wp.array2d[float],
):
    """Smooth the rows of a slab."""
