"""Gradients on the CPU, a vector of pixels at a time."""

import warp as wp

from cvkern.kernels.warp._angles import polar_row
from cvkern.kernels.warp._lanes_cpu import LANES, WIDE, f32_lanes, f32_wide

from ._separable_cpu import both_down, fill_margins, sum_along

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
    smoothed_wide: wp.array2d[f32_wide],
    sloped: wp.array2d[float],  # (slabs, r + N + r)
    sloped_lanes: wp.array2d[f32_lanes],
    sloped_wide: wp.array2d[f32_wide],
    # outputs
    dy: wp.array2d[f32_wide],  # (H, N)
    dx: wp.array2d[f32_wide],  # (H, N)
    dy_rows: wp.array2d[float],  # the same
    dx_rows: wp.array2d[float],
    magnitude: wp.array2d[float],  # (H, N), or None
    orientation: wp.array2d[float],  # (H, N), or None
):
    margin = smooth.shape[0] // 2
    for y in range(first, last):
        for lane in range((stored + LANES - 1) // LANES):
            x = wp.min(lane * LANES, stored - LANES)
            both_down(
                src,
                y,
                x,
                margin + x,
                slab,
                smooth,
                slope,
                border,
                cval,
                smoothed_lanes,
                sloped_lanes,
            )
        fill_margins(smoothed, slab, margin, columns, 1, border, cval_smooth)
        fill_margins(sloped, slab, margin, columns, 1, border, cval_slope)
        for lane in range((stored + WIDE - 1) // WIDE):
            x = wp.min(lane * WIDE, stored - WIDE)
            dy[y, x] = sum_along(sloped_wide, slab, x, 1, smooth)
            dx[y, x] = sum_along(smoothed_wide, slab, x, 1, slope)
        if magnitude:
            polar_row(y, dy_rows, dx_rows, magnitude, orientation)


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
