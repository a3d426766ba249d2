"""Residuals and costs in Taichi; the order of arithmetic is that of Warp's _robust.h."""

import taichi as ti

from cvkern.kernels.codes.geometry import COST_ONE, Model
from cvkern.kernels.taichi._rounding import product, quotient

from . import _epipolar as epipolar

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32x9 = ti.types.vector(9, ti.f32)

FUNDAMENTAL = int(Model.FUNDAMENTAL)


@ti.func
def _transfer(h: f32x9, matches: f32_2, i: ti.i32, zero: ti.i32) -> ti.f32:
    """Return the squared distance of H (x, y) from (u, v)."""
    x, y = matches[0, i], matches[1, i]
    w = (product(h[6], x, zero) + product(h[7], y, zero)) + h[8]
    w = quotient(1.0, w, zero)
    px = (product(h[0], x, zero) + product(h[1], y, zero)) + h[2]
    py = (product(h[3], x, zero) + product(h[4], y, zero)) + h[5]
    dx = product(px, w, zero) - matches[2, i]
    dy = product(py, w, zero) - matches[3, i]
    return product(dx, dx, zero) + product(dy, dy, zero)


@ti.func
def residual(kind: ti.template(), h: f32x9, matches: f32_2, i: ti.i32, zero: ti.i32) -> ti.f32:
    r = ti.cast(0.0, ti.f32)
    if ti.static(kind < FUNDAMENTAL):
        r = _transfer(h, matches, i, zero)
    else:
        r = epipolar.sampson(h, matches[0, i], matches[1, i], matches[2, i], matches[3, i], zero)
    return r


@ti.func
def cost_of(
    kind: ti.template(),
    h: f32x9,
    matches: f32_2,
    start: ti.i32,
    count: ti.i32,
    square: ti.f32,
    zero: ti.i32,
):
    """Return the cost of a model over matches in fixed point, and the number of its inliers."""
    scale = quotient(ti.cast(COST_ONE, ti.f32), square, zero)
    cost = 0
    support = 0
    for i in range(start, start + count):
        r = residual(kind, h, matches, i, zero)
        if r < square:
            cost += ti.cast(product(r, scale, zero) + 0.5, ti.i32)
            support += 1
        else:
            cost += COST_ONE
    return cost, support
