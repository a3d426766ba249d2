"""Values of the next smaller and the next larger level of a pyramid [Burt and Adelson 1983].

Taps are (1, 4, 6, 4, 1) / 16, mirrored at the border, down the columns first.
"""

import taichi as ti

from cvkern.kernels.taichi._rounding import product


@ti.func
def weigh(a: ti.f32, b: ti.f32, c: ti.f32, d: ti.f32, e: ti.f32, zero: ti.i32) -> ti.f32:
    """Return the weighted mean of five values."""
    return (((a + e) + 4.0 * (b + d)) + product(6.0, c, zero)) * 0.0625


@ti.func
def place(i: ti.i32, m: ti.i32, n: ti.i32) -> ti.i32:
    """Return the place in the smaller level, of m of n, that place i is the mirror image of."""
    j = i
    if j < 0:
        j = 1
    if j >= m:
        j = m - 1 - n % 2
    return ti.math.clamp(j, 0, m - 1)


@ti.func
def between(a: ti.f32, b: ti.f32, c: ti.f32, odd: ti.i32, zero: ti.i32) -> ti.f32:
    """Return the value at b, or half way to c."""
    found = ((a + c) + product(6.0, b, zero)) * 0.125
    if odd:
        found = 0.5 * (b + c)
    return found


@ti.func
def enlarged(
    a: ti.template(), k: ti.i32, height: ti.i32, width: ti.i32, y: ti.i32, x: ti.i32, zero: ti.i32
) -> ti.f32:
    """Return pixel (y, x) of plane k of the larger level, of height and width."""
    line = ti.Vector([0.0, 0.0, 0.0])
    rows, columns = a.shape[1], a.shape[2]
    above, below = place(y // 2 - 1, rows, height), place(y // 2 + 1, rows, height)
    for t in ti.static(range(3)):
        u = place(x // 2 + t - 1, columns, width)
        line[t] = between(a[k, above, u], a[k, y // 2, u], a[k, below, u], y % 2, zero)
    return between(line[0], line[1], line[2], x % 2, zero)
