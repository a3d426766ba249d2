"""Gradients on the CPU, a vector of pixels at a time."""

import warp as wp

from ._angles import atan2
from ._lanes import LANES, f32_lanes
from ._separable import fill_margins, sum_along, sum_down

# Without fused multiply-add a sum has the same bits on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def differentiate(
    slab: int,
    first: int,
    last: int,
    src: wp.array2d[f32_lanes],  # (H, N)
    stored: int,  # N
    columns: int,  # W <= N
    smooth: wp.array[float],  # (2 r + 1,)
    slope: wp.array[float],  # (2 r + 1,)
    border: int,
    cval: float,
    cval_smooth: float,
    cval_slope: float,
    # scratch
    smoothed: wp.array2d[float],  # (slabs, r + N + r)
    smoothed_lanes: wp.array2d[f32_lanes],
    sloped: wp.array2d[float],  # (slabs, r + N + r)
    sloped_lanes: wp.array2d[f32_lanes],
    # outputs
    dy: wp.array2d[f32_lanes],  # (H, N)
    dx: wp.array2d[f32_lanes],  # (H, N)
):
    height = src.shape[0]
    margin = smooth.shape[0] // 2
    count = (stored + LANES - 1) // LANES
    for y in range(first, last):
        for lane in range(count):
            x = wp.min(lane * LANES, stored - LANES)
            smoothed_lanes[slab, margin + x] = sum_down(src, 0, y, height, x, smooth, border, cval)
            sloped_lanes[slab, margin + x] = sum_down(src, 0, y, height, x, slope, border, cval)
        fill_margins(smoothed, slab, margin, columns, 1, border, cval_smooth)
        fill_margins(sloped, slab, margin, columns, 1, border, cval_slope)
        for lane in range(count):
            x = wp.min(lane * LANES, stored - LANES)
            dy[y, x] = sum_along(sloped_lanes, slab, x, 1, smooth)
            dx[y, x] = sum_along(smoothed_lanes, slab, x, 1, slope)


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
