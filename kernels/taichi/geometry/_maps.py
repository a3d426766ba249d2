"""Similarities, affine maps and homographies from the fewest points, in Taichi.

A homography through four points follows from areas of triangles: with the scales
``s_i = A_i(b) / A_i(a)`` of three points, ``H p = sum s_i A_i(p) b_i``, where A_i is the area that
point i is left out of. It must keep all four points on one side of the horizon. The order of
arithmetic is that of Warp's _robust.h, so both sets give the same bits.
"""

import taichi as ti

from cvkern.kernels.taichi._rounding import wide_product

f64x8 = ti.types.vector(8, ti.f64)
f64x9 = ti.types.vector(9, ti.f64)


@ti.func
def _area(x: f64x8, y: f64x8, a: ti.i32, b: ti.i32, c: ti.i32, zero: ti.i32) -> ti.f64:
    """Return twice the area of a triangle."""
    one = wide_product(x[b] - x[a], y[c] - y[a], zero)
    return one - wide_product(y[b] - y[a], x[c] - x[a], zero)


@ti.func
def _barycentric(x: f64x8, y: f64x8, u: f64x8, v: f64x8, scale: f64x8, zero: ti.i32) -> f64x9:
    """Map p to the sum over three points of scale_i a_i(p) q_i."""
    h = f64x9(0.0)
    for i in ti.static(range(3)):
        j, k = ti.static((i + 1) % 3, (i + 2) % 3)
        fixed = wide_product(x[j], y[k], zero) - wide_product(x[k], y[j], zero)
        row = ti.Vector([y[j] - y[k], x[k] - x[j], fixed])
        for c in ti.static(range(3)):
            scaled = wide_product(row[c], scale[i], zero)
            h[c] += wide_product(u[i], scaled, zero)
            h[3 + c] += wide_product(v[i], scaled, zero)
            h[6 + c] += scaled
    return h


@ti.func
def homography(x: f64x8, y: f64x8, u: f64x8, v: f64x8, flat: ti.f64, zero: ti.i32):
    """Return whether four points fix a homography with all of them before the horizon, and it."""
    s = f64x8(0.0)
    t = f64x8(0.0)
    for i, corners in ti.static(enumerate(((3, 1, 2), (0, 3, 2), (0, 1, 3), (0, 1, 2)))):
        s[i] = _area(x, y, corners[0], corners[1], corners[2], zero)
        t[i] = _area(u, v, corners[0], corners[1], corners[2], zero)
    mirrored = wide_product(s[3], t[3], zero) < 0.0
    found = True
    for i in ti.static(range(4)):
        found = found and ti.abs(s[i]) > flat and ti.abs(t[i]) > flat
        found = found and (wide_product(s[i], t[i], zero) < 0.0) == mirrored
    scale = f64x8(0.0)
    if found:
        for i in ti.static(range(3)):
            scale[i] = t[i] / s[i]
    return found, _barycentric(x, y, u, v, scale, zero)


@ti.func
def affine(x: f64x8, y: f64x8, u: f64x8, v: f64x8, flat: ti.f64, zero: ti.i32):
    whole = _area(x, y, 0, 1, 2, zero)
    found = ti.abs(whole) > flat and ti.abs(_area(u, v, 0, 1, 2, zero)) > flat
    scale = f64x8(0.0)
    if found:
        scale = f64x8(1.0) / whole
    h = _barycentric(x, y, u, v, scale, zero)
    h[6], h[7], h[8] = 0.0, 0.0, 1.0
    return found, h


@ti.func
def similarity(x: f64x8, y: f64x8, u: f64x8, v: f64x8, flat: ti.f64, zero: ti.i32):
    dx, dy, du, dv = x[1] - x[0], y[1] - y[0], u[1] - u[0], v[1] - v[0]
    square = wide_product(dx, dx, zero) + wide_product(dy, dy, zero)
    found = square > flat and wide_product(du, du, zero) + wide_product(dv, dv, zero) > flat
    h = f64x9(0.0)
    if found:
        a = (wide_product(dx, du, zero) + wide_product(dy, dv, zero)) / square
        b = (wide_product(dx, dv, zero) - wide_product(dy, du, zero)) / square
        h[0], h[1], h[3], h[4], h[8] = a, -b, b, a, 1.0
        h[2] = u[0] - (wide_product(a, x[0], zero) - wide_product(b, y[0], zero))
        h[5] = v[0] - (wide_product(b, x[0], zero) + wide_product(a, y[0], zero))
    return found, h
