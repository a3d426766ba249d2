"""Depth and points on the CPU: one thread per slab of rows; depth.py has the equations.

The code is native, because the loop over a row becomes vector code, divisions included.
"""

import warp as wp

from cvkern.kernels.warp import _native

# Without fused multiply-add a point has the same bits on every device.
_OPTIONS = {"enable_backward": False, "fuse_fp": False}


@_native.kernel("_depth_cpu.h", _OPTIONS)
def depth(
    slab: int,
    first: int,
    last: int,
    disparity: wp.array2d[float],  # (H, W)
    scale: float,
    doffs: float,
    # outputs
    depth: wp.array2d[float],  # (H, W)
): ...


@_native.kernel("_depth_cpu.h", _OPTIONS)
def points(
    slab: int,
    first: int,
    last: int,
    disparity: wp.array2d[float],  # (H, W)
    q: wp.array2d[float],  # (4, 4)
    # outputs
    points: wp.array3d[float],  # (H, W, 3)
): ...
