"""Gradients in polar form on the CPU, a vector of pixels at a time."""

import warp as wp

from ._angles import atan2
from ._lanes import LANES, f32_lanes

# Without fused multiply-add a sum has the same bits on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def polar(
    slab: int,
    first: int,
    last: int,
    dy: wp.array2d[f32_lanes],  # (1, N)
    dx: wp.array2d[f32_lanes],
    # outputs
    magnitude: wp.array2d[f32_lanes],
    orientation: wp.array2d[f32_lanes],
):
    for lane in range(first, last):
        i = wp.min(lane * LANES, dy.shape[1] - 1)
        y = dy[0, i]
        x = dx[0, i]
        length = f32_lanes()
        angle = f32_lanes()
        for k in range(LANES):
            length[k] = wp.sqrt(x[k] * x[k] + y[k] * y[k])
            angle[k] = atan2(y[k], x[k])
        magnitude[0, i] = length
        orientation[0, i] = angle


@wp.kernel
def root_mean_square(
    slab: int,
    first: int,
    last: int,
    dy: wp.array2d[f32_lanes],  # (1, N)
    dx: wp.array2d[f32_lanes],
    # outputs
    dst: wp.array2d[f32_lanes],
):
    for lane in range(first, last):
        i = wp.min(lane * LANES, dy.shape[1] - 1)
        y = dy[0, i]
        x = dx[0, i]
        root = f32_lanes()
        for k in range(LANES):
            root[k] = wp.sqrt((x[k] * x[k] + y[k] * y[k]) * 0.5)
        dst[0, i] = root
