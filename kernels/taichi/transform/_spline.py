"""Coefficients of the cubic B-spline that passes through the pixels, in Taichi.

With the pole ``z = sqrt(3) - 2``, a recursion there, ``c+_k = 6 s_k + z c+_(k-1)``, and back,
``c_k = z (c_(k+1) - c+_k)``, along each line gives the coefficients of the pixels s [M. Unser,
A. Aldroubi and M. Eden, "B-spline signal processing", IEEE Trans. Signal Processing 41, 1993].
Lines are continued as scipy.ndimage does. One thread takes a line.
"""

import taichi as ti

from cvkern.kernels.codes.transform import SPLINE_GAIN, SPLINE_POLE, SPLINE_REACH
from cvkern.kernels.taichi._rounding import wide_product

f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
f32_4 = ti.types.ndarray(dtype=ti.f32, ndim=4)
f64_4 = ti.types.ndarray(dtype=ti.f64, ndim=4)


@ti.func
def gained(v: ti.f32, zero: ti.i32) -> ti.f64:
    """Return the gain of the filter times a pixel."""
    return wide_product(SPLINE_GAIN, ti.cast(v, ti.f64), zero)


@ti.func
def first_of(lines: ti.template(), o: ti.i32, i: ti.i32, reflect: ti.i32, zero: ti.i32) -> ti.f64:
    """Return the causal coefficient of the first pixel, of a line mirrored without end."""
    n = lines.shape[1]
    z = ti.f64(SPLINE_POLE)
    far = ti.cast(0.0, ti.f64)  # z^(n - 1), or z^n
    if n <= SPLINE_REACH:
        far = 1.0
        for _ in range(n - 1 + reflect):
            far = wide_product(far, z, zero)
    start = gained(lines[o, 0, i], zero)
    total = start + wide_product(far, gained(lines[o, n - 1, i], zero), zero)
    power = z
    for k in range(1, ti.min(n - 1 + reflect, SPLINE_REACH)):
        back = wide_product(far, gained(lines[o, n - 1 - k, i], zero), zero)
        total = total + wide_product(power, gained(lines[o, k, i], zero) + back, zero)
        power = wide_product(power, z, zero)
    rest = 1.0 - wide_product(far, far, zero)
    found = total / rest
    if reflect == 1:
        found = wide_product(total, z / rest, zero) + start
    return found


@ti.kernel
def recurse(
    reflect: ti.i32,
    zero: ti.i32,
    # in place
    lines: f32_3,  # (outer, n, inner)
):
    for o, i in ti.ndrange(lines.shape[0], lines.shape[2]):
        n = lines.shape[1]
        z = ti.f64(SPLINE_POLE)
        value = first_of(lines, o, i, reflect, zero)
        lines[o, 0, i] = ti.cast(value, ti.f32)
        before = value
        for k in range(1, n):
            before = value
            value = gained(lines[o, k, i], zero) + wide_product(z, value, zero)
            lines[o, k, i] = ti.cast(value, ti.f32)
        if reflect == 1:
            value = wide_product(value, z / (z - 1.0), zero)
        else:
            ends = wide_product(z, before, zero) + value
            value = wide_product(ends, z / (wide_product(z, z, zero) - 1.0), zero)
        lines[o, n - 1, i] = ti.cast(value, ti.f32)
        for k in range(1, n):
            value = wide_product(z, value - ti.cast(lines[o, n - 1 - k, i], ti.f64), zero)
            lines[o, n - 1 - k, i] = ti.cast(value, ti.f32)


@ti.kernel
def pad(
    src: f32_4,
    margin: ti.i32,
    # outputs
    dst: f32_4,
):
    for p, y, x, c in dst:
        i = ti.math.clamp(y - margin, 0, src.shape[1] - 1)
        j = ti.math.clamp(x - margin, 0, src.shape[2] - 1)
        dst[p, y, x, c] = src[p, i, j, c]


@ti.func
def edge(i: ti.i32, n: ti.i32) -> ti.f32:
    """Return the weight of a pixel of a mirrored line: a half at its ends, 1 between."""
    counts = 1.0
    if n > 1 and (i == 0 or i == n - 1):
        counts = 0.5
    return counts


@ti.kernel
def narrow(
    sums: f64_4,
    mirrored: ti.i32,
    # outputs
    dst: f32_4,
):
    # The filter F of a mirrored line has the transpose D F D^-1, where D halves the ends: this
    # divides by D, `fold` multiplies.
    for p, y, x, c in dst:
        ends = 1.0
        if mirrored == 1:
            ends = edge(y, sums.shape[1]) * edge(x, sums.shape[2])
        dst[p, y, x, c] = ti.cast(sums[p, y, x, c], ti.f32) / ends


@ti.kernel
def fold(
    padded: f32_4,  # (P, H + 2 margin, W + 2 margin, C)
    margin: ti.i32,
    mirrored: ti.i32,
    # outputs
    dst: f32_4,  # (P, H, W, C)
):
    # The gradients of the copies of a pixel in the margin are its own.
    for p, y, x, c in dst:
        height = dst.shape[1]
        width = dst.shape[2]
        top = 0 if y == 0 else y + margin
        bottom = height + 2 * margin if y == height - 1 else y + margin + 1
        left = 0 if x == 0 else x + margin
        right = width + 2 * margin if x == width - 1 else x + margin + 1
        total = 0.0
        for i in range(top, bottom):
            for j in range(left, right):
                total = total + padded[p, i, j, c]
        if mirrored == 1:
            total = total * (edge(y, height) * edge(x, width))
        dst[p, y, x, c] = total
