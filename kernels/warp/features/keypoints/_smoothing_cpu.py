"""Smoothing of the levels of a scale space on the CPU: a thread takes a slab of rows.

The code (_smoothing_cpu.h) is native, because two rows share loads, and no arithmetic of indices
stands between the sums.
"""

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
