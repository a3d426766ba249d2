"""Gradients on the CPU: one thread per slab of rows, one vector of pixels at a time.

A derivative is a difference in one direction and a smoothing in the other. Lines of scratch hold
the sums of the rows around a row, which are then correlated along the row. Two rows whose windows
lie inside the image are processed together, as in _linear_cpu.py.
"""

from typing import Any

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp._lanes_cpu import LANES, WIDE, f32_lanes, f32_wide
from cvkern.kernels.warp._structs import struct_of

from ._linear_cpu import along, pair_down
from ._separable_cpu import Lines, fill_margins, sum_down

# Without fused multiply-add a sum has the same bits on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False})

STRIP = 512  # columns whose rows stay in the fastest cache between two sums


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


@_native.func_native("_gradients_cpu.h")
def polar_row(
    dy: wp.array3d[f32_wide],  # (1, H, N - 63)
    dx: wp.array3d[f32_wide],
    row: int,
    size: int,
    # outputs
    magnitude: wp.array3d[f32_wide],
    orientation: wp.array3d[f32_wide],
):
    """Write the lengths and the angles of `size` derivatives of a row."""


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
    lines: Lines,  # (4 slabs, r + N + r): two smoothed rows, and two rows of differences
    # outputs
    dy: wp.array3d[f32_wide],  # (1, H, N - 63)
    dx: wp.array3d[f32_wide],
    magnitude: wp.array3d[f32_wide],  # None where it is not asked for
    orientation: wp.array3d[f32_wide],
):
    height = dy.shape[1]
    stored = dy.shape[2] + WIDE - 1
    reach = smooth.shape[0] // 2
    smoothed = 4 * slab
    sloped = smoothed + 2
    border = outside.border
    columns = outside.columns
    y = int(first)
    while y < last:
        pair = y + 1 < last and y >= reach and y + 1 + reach < height
        if pair:
            for begin in range(0, stored, STRIP):
                end = wp.min(begin + STRIP, stored)
                pair_down(src, y, smooth, lines.values, smoothed, reach, begin, end)
                pair_down(src, y, slope, lines.values, sloped, reach, begin, end)
        else:
            for lane in range((stored + LANES - 1) // LANES):
                x = wp.min(lane * LANES, stored - LANES)
                lines.lanes[smoothed, reach + x] = sum_down(
                    src, 0, y, height, x, smooth, border, outside.cval
                )
                lines.lanes[sloped, reach + x] = sum_down(
                    src, 0, y, height, x, slope, border, outside.cval
                )
        for k in range(wp.where(pair, 2, 1)):
            fill_margins(lines.values, smoothed + k, reach, columns, 1, border, outside.smooth)
            fill_margins(lines.values, sloped + k, reach, columns, 1, border, outside.slope)
            along(lines.values, sloped + k, 1, smooth, stored, dy, y + k)
            along(lines.values, smoothed + k, 1, slope, stored, dx, y + k)
            if magnitude:
                polar_row(dy, dx, y + k, stored, magnitude, orientation)
        y += wp.where(pair, 2, 1)


@wp.kernel
def polar(
    slab: int,
    first: int,
    last: int,
    dy: wp.array3d[f32_wide],  # (1, H, N - 63)
    dx: wp.array3d[f32_wide],
    # outputs
    magnitude: wp.array3d[f32_wide],
    orientation: wp.array3d[f32_wide],
):
    for y in range(first, last):
        polar_row(dy, dx, y, dy.shape[2] + WIDE - 1, magnitude, orientation)


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


@wp.kernel
def add(
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
        dst[0, i] = dy[0, i] + dx[0, i]
