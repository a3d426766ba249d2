"""Corners in Taichi: structure tensors, their measures, maxima, and places within the pixel.

The structure tensor A of a pixel has the weighted sums of ``(I_y^2, I_y I_x, I_x^2)`` around it.
The measure of a corner is ``det A - k (tr A)^2`` [C. Harris and M. Stephens, Alvey Vision
Conference 1988], ``2 det A / (tr A + eps)`` [J. A. Noble, thesis, Oxford 1989], or the smaller
eigenvalue of A [J. Shi and C. Tomasi, CVPR 1994].

Within the pixel, a corner is the point p that lies closest to the lines through the pixels q of a
window, ``sum (g . (p - q))^2`` for the gradients g; a dot is the point that the gradients point to
[W. Foerstner and E. Guelch, ISPRS Intercommission Workshop 1987]. The one that fits better is
taken. One thread takes a pixel, or a point.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.features import Corner
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._rounding import product, quotient, root, wide_product

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)


@primitive
def multiply(
    dy: np.ndarray, dx: np.ndarray, yy: np.ndarray, yx: np.ndarray, xx: np.ndarray
) -> None:
    """Products of the derivatives; one thread a pixel."""
    _multiply(dy, dx, yy, yx, xx)


@ti.kernel
def _multiply(
    dy: f32_1,
    dx: f32_1,
    # outputs
    yy: f32_1,
    yx: f32_1,
    xx: f32_1,
):
    for i in dy:
        yy[i] = dy[i] * dy[i]
        yx[i] = dy[i] * dx[i]
        xx[i] = dx[i] * dx[i]


@primitive
def measure(
    yy: np.ndarray,
    yx: np.ndarray,
    xx: np.ndarray,
    rule: int,
    k: float,
    eps: float,
    dst: np.ndarray,
) -> None:
    """Measure how much of a corner a structure tensor is; one thread a pixel."""
    _measure(yy, yx, xx, rule, k, eps, 0, dst)


@ti.kernel
def _measure(
    yy: f32_1,
    yx: f32_1,
    xx: f32_1,
    rule: ti.i32,
    k: ti.f32,
    eps: ti.f32,
    zero: ti.i32,
    # outputs
    dst: f32_1,
):
    for i in dst:
        trace = yy[i] + xx[i]
        mixed = product(yx[i], yx[i], zero)
        if rule == Corner.SHI_TOMASI:  # the smaller eigenvalue
            gap = yy[i] - xx[i]
            squared = product(gap, gap, zero) + product(4.0, mixed, zero)
            dst[i] = 0.5 * (trace - root(squared, zero))
        else:
            det = product(yy[i], xx[i], zero) - mixed
            if rule == Corner.HARRIS:
                dst[i] = det - product(k, product(trace, trace, zero), zero)
            else:
                dst[i] = quotient(2.0 * det, trace + eps, zero)


@primitive
def mark_maxima(
    src: np.ndarray, distance: int, threshold: float, margin: int, mask: np.ndarray
) -> None:
    """Mark pixels above a threshold that no pixel of their window exceeds; one thread a pixel."""
    _mark(src, distance, threshold, margin, mask)


@ti.kernel
def _mark(
    src: f32_2,
    distance: ti.i32,
    threshold: ti.f32,
    margin: ti.i32,
    # outputs
    mask: u8_2,
):
    for y, x in src:
        height = src.shape[0]
        width = src.shape[1]
        v = src[y, x]
        found = 1 if v > threshold else 0
        if y < margin or y >= height - margin or x < margin or x >= width - margin:
            found = 0
        if found == 1:
            for i in range(ti.max(y - distance, 0), ti.min(y + distance, height - 1) + 1):
                for j in range(ti.max(x - distance, 0), ti.min(x + distance, width - 1) + 1):
                    if src[i, j] > v:
                        found = 0
        mask[y, x] = ti.cast(found, ti.u8)


@primitive
def locate(
    src: np.ndarray, points: np.ndarray, reach: int, dot: float, edge: float, places: np.ndarray
) -> None:
    """Find the point that the gradients of a window meet in or circle about; a thread a point."""
    _locate(src, points, reach, dot, edge, 0, places)


@ti.func
def _pixel(src: ti.template(), y: ti.i32, x: ti.i32) -> ti.f64:
    """Return a pixel, 0 outside the image."""
    v = ti.cast(0.0, ti.f64)
    if y >= 0 and x >= 0 and y < src.shape[0] and x < src.shape[1]:
        v = ti.cast(src[y, x], ti.f64)
    return v


@ti.func
def _pair(a: ti.f64, b: ti.f64, c: ti.f64, d: ti.f64, zero: ti.i32) -> ti.f64:
    """Return a b + c d."""
    return wide_product(a, b, zero) + wide_product(c, d, zero)


@ti.kernel
def _locate(
    src: f32_2,
    points: i32_2,
    reach: ti.i32,
    dot: ti.f32,
    edge: ti.f32,
    zero: ti.i32,
    # outputs
    places: f32_2,
):
    for n in range(points.shape[0]):
        cy = points[n, 0]
        cx = points[n, 1]
        none = ti.cast(0.0, ti.f64)
        xx, xy, yy = none, none, none
        xx_y, xx_x, xy_y, xy_x, yy_y, yy_x = none, none, none, none, none, none
        spin = none  # moments of the second order: across the gradient, and along it
        meet = none
        for i in range(-reach, reach + 1):
            for j in range(-reach, reach + 1):
                y = cy + i
                x = cx + j
                nw = _pixel(src, y - 1, x - 1)
                ne = _pixel(src, y - 1, x + 1)
                sw = _pixel(src, y + 1, x - 1)
                se = _pixel(src, y + 1, x + 1)
                gy = (sw - nw) + 2.0 * (_pixel(src, y + 1, x) - _pixel(src, y - 1, x)) + (se - ne)
                gx = (ne - nw) + 2.0 * (_pixel(src, y, x + 1) - _pixel(src, y, x - 1)) + (se - sw)
                v = ti.cast(i, ti.f64)
                u = ti.cast(j, ti.f64)
                a = wide_product(gx, gx, zero)
                b = wide_product(gx, gy, zero)
                c = wide_product(gy, gy, zero)
                xx = xx + a
                xy = xy + b
                yy = yy + c
                xx_y = xx_y + wide_product(a, v, zero)
                xx_x = xx_x + wide_product(a, u, zero)
                xy_y = xy_y + wide_product(b, v, zero)
                xy_x = xy_x + wide_product(b, u, zero)
                yy_y = yy_y + wide_product(c, v, zero)
                yy_x = yy_x + wide_product(c, u, zero)
                mixed = 2.0 * wide_product(b, u * v, zero)
                aa = wide_product(a, v * v, zero)
                cc = wide_product(c, u * u, zero)
                spin = spin + (aa - mixed + cc)
                aa = wide_product(c, v * v, zero)
                cc = wide_product(a, u * u, zero)
                meet = meet + (aa + mixed + cc)
        row = ti.math.nan
        column = ti.math.nan
        det = wide_product(xx, yy, zero) - wide_product(xy, xy, zero)
        if det != 0.0:
            # A dot: lines along the gradients meet in it. An edge corner: lines across do.
            r = xx_y - xy_x
            s = yy_x - xy_y
            dot_y = _pair(yy, r, xy, s, zero) / det
            dot_x = _pair(xy, r, xx, s, zero) / det
            t = yy_y + xy_x
            w = xx_x + xy_y
            edge_y = _pair(xx, t, -xy, w, zero) / det
            edge_x = _pair(yy, w, -xy, t, zero) / det
            # At the least squares solution the sum is the constant less what the solution gains.
            of_dot = spin - _pair(dot_y, r, dot_x, s, zero)
            of_edge = meet - _pair(edge_y, t, edge_x, w, zero)
            least = ti.f64(2.220446049250313e-16)
            if not (of_dot < least and of_edge < least):
                ratio = of_edge / of_dot
                if of_dot != 0.0 and ratio < ti.cast(edge, ti.f64):
                    row = ti.cast(ti.cast(cy, ti.f64) + edge_y, ti.f32)
                    column = ti.cast(ti.cast(cx, ti.f64) + edge_x, ti.f32)
                elif of_dot == 0.0 or ratio > ti.cast(dot, ti.f64):
                    row = ti.cast(ti.cast(cy, ti.f64) + dot_y, ti.f32)
                    column = ti.cast(ti.cast(cx, ti.f64) + dot_x, ti.f32)
        places[n, 0] = row
        places[n, 1] = column
