"""Residuals and costs of models over matches, in Taichi; robust.py has the equations.

The order of arithmetic is that of Warp's _robust.h, so both sets give the same bits.
"""

import taichi as ti

from cvkern.kernels.codes.geometry import COST_ONE, Model
from cvkern.kernels.taichi._rounding import product, quotient

from . import _epipolar as epipolar
from . import _pose as pose
from ._essential import camera

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f64_2 = ti.types.ndarray(dtype=ti.f64, ndim=2)
f32x9 = ti.types.vector(9, ti.f32)
f32x12 = ti.types.vector(12, ti.f32)

FUNDAMENTAL, POSE = int(Model.FUNDAMENTAL), int(Model.POSE)


@ti.func
def _transfer(h: f32x12, x: ti.f32, y: ti.f32, u: ti.f32, v: ti.f32, zero: ti.i32) -> ti.f32:
    """Return the squared distance of H (x, y) from (u, v)."""
    w = (product(h[6], x, zero) + product(h[7], y, zero)) + h[8]
    w = quotient(1.0, w, zero)
    px = (product(h[0], x, zero) + product(h[1], y, zero)) + h[2]
    py = (product(h[3], x, zero) + product(h[4], y, zero)) + h[5]
    dx = product(px, w, zero) - u
    dy = product(py, w, zero) - v
    return product(dx, dx, zero) + product(dy, dy, zero)


@ti.func
def prepared(kind: ti.template(), model: f32x9, known: f64_2, pair: ti.i32, zero: ti.i32) -> f32x12:
    """Return the numbers that residuals need: a matrix, or the twelve numbers of a projection."""
    f = f32x12(0.0)
    for i in ti.static(range(9)):
        f[i] = model[i]
    if ti.static(kind == POSE):
        h = ti.cast(model, ti.f64)
        f = ti.cast(pose.project(h, camera(known, pair, 0), zero), ti.f32)
    return f


@ti.func
def residual(kind: ti.template(), h: f32x12, matches: f32_2, i: ti.i32, zero: ti.i32) -> ti.f32:
    r = ti.cast(0.0, ti.f32)
    x, y, u, v = matches[0, i], matches[1, i], matches[2, i], matches[3, i]
    if ti.static(kind == POSE):
        r = pose.residual(h, x, y, matches[4, i], u, v, zero)
    elif ti.static(kind < FUNDAMENTAL):
        r = _transfer(h, x, y, u, v, zero)
    else:
        r = epipolar.sampson(h, x, y, u, v, zero)
    return r


@ti.func
def cost_of(
    kind: ti.template(),
    h: f32x12,
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
