"""The two passes of a separable filter over lanes, shared by the CPU kernels of several families.

A line of scratch holds one row between the passes; pixel 0 stands at element `margin`.
"""

import warp as wp

from ._borders import border_index
from ._lanes import f32_lanes


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
    """Weigh the rows round row `y` of a plane by the taps, for the vector at `x`."""
    n = taps.shape[0]
    first = y - n // 2
    acc = f32_lanes(0.0)
    if first >= 0 and first + n <= height:
        for t in range(n):
            acc += taps[t] * src[top + first + t, x]
    else:
        for t in range(n):
            i = border_index(first + t, height, border)
            if i >= 0:
                acc += taps[t] * src[top + i, x]
            else:
                acc += f32_lanes(taps[t] * cval)
    return acc


@wp.func
def sum_along(
    line: wp.array2d[f32_lanes], slab: int, x: int, step: int, taps: wp.array[float]
) -> f32_lanes:
    """Weigh the pixels round the vector at `x` of a line by the taps."""
    acc = f32_lanes(0.0)
    for t in range(taps.shape[0]):
        acc += taps[t] * line[slab, x + t * step]
    return acc


@wp.func
def fill_margins(
    line: wp.array2d[float],
    slab: int,
    margin: int,
    columns: int,
    step: int,
    border: int,
    cval: float,
):
    """Write what lies outside the row, by `border`, on both sides of it."""
    for i in range(margin):
        line[slab, i] = outside(line, slab, margin, i - margin, columns, step, border, cval)
        line[slab, margin + columns + i] = outside(
            line, slab, margin, columns + i, columns, step, border, cval
        )


@wp.func
def outside(
    line: wp.array2d[float],
    slab: int,
    margin: int,
    i: int,
    columns: int,
    step: int,
    border: int,
    cval: float,
) -> float:
    """Value that `border` gives element `i` of the row."""
    pixel = wp.floordiv(i, step)
    inside = border_index(pixel, columns // step, border)
    if inside < 0:
        return cval
    return line[slab, margin + inside * step + i - pixel * step]
