"""Directions of edge points, one thread a point, on the CPU and on CUDA."""

import warp as wp

from cvkern.kernels.warp._angles import atan2
from cvkern.kernels.warp.hough._directions import direction_code

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def code_directions(
    points: wp.array2d[int],  # (N, 2)
    dy: wp.array2d[float],  # (H, W)
    dx: wp.array2d[float],  # (H, W)
    # outputs
    codes: wp.array[int],  # (N,)
):
    i = wp.tid()
    y = points[i, 0]
    x = points[i, 1]
    codes[i] = direction_code(atan2(dy[y, x], dx[y, x]))
