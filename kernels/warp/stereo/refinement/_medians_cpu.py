"""Weighted medians on the CPU: one thread per slab of rows, 16 pixels at once.

medians.py has the rule. The code is native, because the pairs of values of a window are compared in
vectors of 16 pixels.
"""

import warp as wp

from cvkern.kernels.warp import _native

MAX_RADIUS = 15
_OPTIONS = {"enable_backward": False, "fuse_fp": False}


@_native.kernel("_medians_rows_cpu.h", _OPTIONS, MOST=2 * MAX_RADIUS + 1)
def medians(
    slab: int,
    first: int,
    last: int,
    disparity: wp.array2d[float],  # (H, W)
    guide: wp.array2d[wp.uint8],  # (H, W)
    radius: int,
    contrast: int,
    down: bool,  # the columns, or along the rows
    # scratch
    lines: wp.array2d[float],  # (slabs, W + 2 radius)
    gray_lines: wp.array2d[wp.uint8],  # (slabs, W + 2 radius)
    # outputs
    smooth: wp.array2d[float],  # (H, W)
): ...
