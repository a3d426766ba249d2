"""The two passes of a separable filter over lanes, shared by the CPU kernels of linear filters.

A line of scratch holds one row between the passes; pixel 0 is at element `margin`.
"""

from typing import Any

import warp as wp

from cvkern.kernels.warp._borders import border_index
from cvkern.kernels.warp._internals import view_at
from cvkern.kernels.warp._lanes_cpu import f32_lanes, vectors
from cvkern.kernels.warp._launch import scratch

REGISTER = 16  # floats; sums of three pixels take 1.2 times as long if lines are not aligned


@wp.struct
class Lines:
    """Lines of scratch, as floats and as vectors that start at each of them."""

    values: wp.array2d[float]
    lanes: wp.array2d[f32_lanes]


def lines(name: str, count: int, size: int, margin: int, device: Any) -> Any:
    """Return scratch memory as lines of `size` pixels between margins; pixel 0 is aligned."""
    pitch = -(-(size + 2 * margin) // REGISTER) * REGISTER
    values = scratch(name, (count + 1, pitch), wp.float32, device)
    address = values.ptr or 0
    start = -(address // 4 + margin) % REGISTER
    kept = values.__dict__.setdefault("lines", {})
    if start not in kept:
        made = kept[start] = Lines()
        made.values = view_at(address + 4 * start, wp.float32, (count, pitch), device)
        made.values.owner = values
        made.lanes = vectors(made.values, f32_lanes)
    return kept[start]


@wp.func
def sum_down(
    src: wp.array2d[f32_lanes],  # (P H, N)
    top: int,  # first row of the plane
    y: int,
    height: int,
    x: int,
    taps: wp.array[float],
    border: int,
    cval: float,
) -> f32_lanes:
    """Sum the rows around row `y` of a plane, weighted by the taps, for the vector at `x`."""
    n = taps.shape[0]
    first = y - n // 2
    acc = f32_lanes(0.0)
    if first >= 0 and first + n <= height:
        for t in range(n):
            acc += taps[t] * src[top + first + t, x]
    else:
        for t in range(n):
            i = border_index(first + t, height, border)
            v = f32_lanes(cval)
            if i >= 0:
                v = src[top + i, x]
            acc += taps[t] * v
    return acc


@wp.func
def fill_margins(
    line: wp.array2d[float],
    row: int,
    margin: int,
    columns: int,
    step: int,
    border: int,
    cval: float,
):
    """Write the values outside a row, by `border`, on both sides of it."""
    for i in range(margin):
        line[row, i] = outside(line, row, margin, i - margin, columns, step, border, cval)
        line[row, margin + columns + i] = outside(
            line, row, margin, columns + i, columns, step, border, cval
        )


@wp.func
def outside(
    line: wp.array2d[float],
    row: int,
    margin: int,
    i: int,
    columns: int,
    step: int,
    border: int,
    cval: float,
) -> float:
    """Return the value of element `i` of a row; `border` gives those outside."""
    pixel = wp.floordiv(i, step)
    inside = border_index(pixel, columns // step, border)
    if inside < 0:
        return cval
    return line[row, margin + inside * step + i - pixel * step]
