"""Gradients on the CPU: one thread per slab of rows, one vector of pixels at a time.

A derivative is a difference in one direction and a smoothing in the other. The rows around a row
are read once for both derivatives; two lines of scratch hold their sums, which are then correlated
along the row.
"""

from typing import Any

import warp as wp

from cvkern.kernels.warp._angles import atan2
from cvkern.kernels.warp._lanes_cpu import LANES, WIDE, f32_lanes, f32_wide
from cvkern.kernels.warp._structs import struct_of

from ._separable_cpu import Lines, both_down, fill_margins, sum_along

# Without fused multiply-add a sum has the same bits on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Outside:
    """The width of the image, and the values outside; see `codes.filters.Outside`."""

    columns: int  # W <= N
    border: int
    cval: float
    smooth: float
    slope: float


def outside_of(columns: int, given: Any) -> Any:
    """Return the structure of an `Outside`."""
    return struct_of(Outside, (columns, *given))


@wp.func
def lengths(dy: f32_wide, dx: f32_wide) -> f32_wide:
    """Return ``sqrt(dx^2 + dy^2)``."""
    squares = wp.cw_mul(dx, dx) + wp.cw_mul(dy, dy)
    for k in range(WIDE):
        squares[k] = wp.sqrt(squares[k])
    return squares


@wp.func
def angles(dy: f32_wide, dx: f32_wide) -> f32_wide:
    """Return the angle of each (dx, dy)."""
    turned = f32_wide()
    for k in range(WIDE):
        turned[k] = atan2(dy[k], dx[k])
    return turned


@wp.kernel
def differentiate(
    slab: int,
    first: int,
    last: int,
    src: wp.array2d[f32_lanes],  # (H, N - 31)
    smooth: wp.array[float],  # (2 r + 1,)
    slope: wp.array[float],  # (2 r + 1,)
    outside: Outside,
    # scratch
    lines: Lines,  # (2 slabs, r + N + r): smoothed rows, and rows of differences
    # outputs
    dy: wp.array2d[f32_wide],  # (H, N - 63)
    dx: wp.array2d[f32_wide],
    magnitude: wp.array2d[f32_wide],  # None where it is not asked for
    orientation: wp.array2d[f32_wide],
):
    stored = dy.shape[1] + WIDE - 1
    margin = smooth.shape[0] // 2
    smoothed = 2 * slab
    sloped = 2 * slab + 1
    for y in range(first, last):
        for lane in range((stored + LANES - 1) // LANES):
            x = wp.min(lane * LANES, stored - LANES)
            both_down(
                src, y, x, smooth, slope, outside.border, outside.cval, lines.lanes,
                smoothed, margin + x,
            )  # fmt: skip
        columns = outside.columns
        border = outside.border
        fill_margins(lines.values, smoothed, margin, columns, 1, border, outside.smooth)
        fill_margins(lines.values, sloped, margin, columns, 1, border, outside.slope)
        for lane in range((stored + WIDE - 1) // WIDE):
            x = wp.min(lane * WIDE, stored - WIDE)
            down = sum_along(lines.wide, sloped, x, 1, smooth)
            along = sum_along(lines.wide, smoothed, x, 1, slope)
            dy[y, x] = down
            dx[y, x] = along
            if magnitude:
                magnitude[y, x] = lengths(down, along)
                orientation[y, x] = angles(down, along)


@wp.kernel
def polar(
    slab: int,
    first: int,
    last: int,
    dy: wp.array2d[f32_wide],  # (1, N)
    dx: wp.array2d[f32_wide],
    # outputs
    magnitude: wp.array2d[f32_wide],
    orientation: wp.array2d[f32_wide],
):
    for lane in range(first, last):
        i = wp.min(lane * WIDE, dy.shape[1] - 1)
        magnitude[0, i] = lengths(dy[0, i], dx[0, i])
        orientation[0, i] = angles(dy[0, i], dx[0, i])


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
