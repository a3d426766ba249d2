"""Residuals of bundle adjustment, their derivatives and their costs: a thread a sighting.

adjustment.py has the equations, and codes/reconstruction.py what the columns of each array are.
"""

import taichi as ti

from cvkern.kernels.codes.reconstruction import BEHIND, JOINED, NEAREST, Loss

f64_1 = ti.types.ndarray(dtype=ti.f64, ndim=1)
f64_2 = ti.types.ndarray(dtype=ti.f64, ndim=2)
f64_3 = ti.types.ndarray(dtype=ti.f64, ndim=3)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
HUBER, CAUCHY = int(Loss.HUBER), int(Loss.CAUCHY)


@ti.func
def _turned(views: ti.template(), c: ti.i32, points: ti.template(), p: ti.i32):
    """Return R W."""
    x, y, z = points[p, 0], points[p, 1], points[p, 2]
    return ti.Vector(
        [
            views[c, 0] * x + views[c, 1] * y + views[c, 2] * z,
            views[c, 3] * x + views[c, 4] * y + views[c, 5] * z,
            views[c, 6] * x + views[c, 7] * y + views[c, 8] * z,
        ]
    )


@ti.func
def _radial(lenses: ti.template(), n: ti.i32, r2: ti.f64) -> ti.f64:
    """Return by how much a lens stretches a direction of the squared length r2."""
    return ti.f64(1.0) + r2 * (lenses[n, 4] + r2 * (lenses[n, 5] + r2 * lenses[n, 8]))


@ti.func
def _bent(lenses: ti.template(), n: ti.i32, u: ti.f64, v: ti.f64):
    """Return where a lens shows the direction (u, v, 1)."""
    r2 = u * u + v * v
    p1 = lenses[n, 6]
    p2 = lenses[n, 7]
    grown = _radial(lenses, n, r2)
    return ti.Vector(
        [
            u * grown + ti.f64(2.0) * p1 * u * v + p2 * (r2 + ti.f64(2.0) * u * u),
            v * grown + p1 * (r2 + ti.f64(2.0) * v * v) + ti.f64(2.0) * p2 * u * v,
        ]
    )


@ti.kernel
def measure(
    views: f64_2,
    lenses: f64_2,
    points: f64_2,
    where: f64_2,
    ends: i32_2,
    # outputs
    gaps: f64_2,
):
    for o in range(gaps.shape[0]):
        c = ends[o, 0]
        n = ends[o, 1]
        q = _turned(views, c, points, ends[o, 2])
        z = q[2] + views[c, 11]
        gaps[o, 0] = BEHIND
        gaps[o, 1] = BEHIND
        if z > NEAREST:
            there = _bent(lenses, n, (q[0] + views[c, 9]) / z, (q[1] + views[c, 10]) / z)
            gaps[o, 0] = lenses[n, 0] * there[0] + lenses[n, 2] - where[o, 0]
            gaps[o, 1] = lenses[n, 1] * there[1] + lenses[n, 3] - where[o, 1]


@ti.kernel
def linearise(
    views: f64_2,
    lenses: f64_2,
    points: f64_2,
    where: f64_2,
    ends: i32_2,
    loss: ti.i32,
    scale: ti.f64,
    # outputs
    slopes: f64_3,
    gaps: f64_2,
    weights: f64_1,
):
    width = slopes.shape[2]
    for o in range(weights.shape[0]):
        c = ends[o, 0]
        n = ends[o, 1]
        q = _turned(views, c, points, ends[o, 2])
        z = q[2] + views[c, 11]
        if z > NEAREST:
            u = (q[0] + views[c, 9]) / z
            v = (q[1] + views[c, 10]) / z
            there = _bent(lenses, n, u, v)
            fx = lenses[n, 0]
            fy = lenses[n, 1]
            dx = fx * there[0] + lenses[n, 2] - where[o, 0]
            dy = fy * there[1] + lenses[n, 3] - where[o, 1]
            gaps[o, 0] = dx
            gaps[o, 1] = dy
            square = dx * dx + dy * dy
            weight = ti.f64(1.0)
            if loss == HUBER:
                if square > scale * scale:
                    weight = scale / ti.sqrt(square)
            elif loss == CAUCHY:
                weight = ti.f64(1.0) / (ti.f64(1.0) + square / (scale * scale))
            weights[o] = weight
            # Derivatives of the bent place, which are symmetric, over the depth.
            r2 = u * u + v * v
            k1 = lenses[n, 4]
            k2 = lenses[n, 5]
            p1 = lenses[n, 6]
            p2 = lenses[n, 7]
            grown = _radial(lenses, n, r2)
            steep = ti.f64(2.0) * (k1 + r2 * (ti.f64(2.0) * k2 + ti.f64(3.0) * lenses[n, 8] * r2))
            xx = (grown + steep * u * u + ti.f64(2.0) * p1 * v + ti.f64(6.0) * p2 * u) / z
            xy = (steep * u * v + ti.f64(2.0) * p1 * u + ti.f64(2.0) * p2 * v) / z
            yy = (grown + steep * v * v + ti.f64(6.0) * p1 * v + ti.f64(2.0) * p2 * u) / z
            for k in range(2):
                a = ti.select(k == 0, fx * xx, fy * xy)
                b = ti.select(k == 0, fx * xy, fy * yy)
                d = -(a * u + b * v)
                for j in range(3):
                    slopes[o, k, j] = a * views[c, j] + b * views[c, 3 + j] + d * views[c, 6 + j]
                slopes[o, k, 3] = d * q[1] - b * q[2]
                slopes[o, k, 4] = a * q[2] - d * q[0]
                slopes[o, k, 5] = b * q[0] - a * q[1]
                slopes[o, k, 6] = a
                slopes[o, k, 7] = b
                slopes[o, k, 8] = d
            if width > 9:
                slopes[o, 0, 9] = fx * there[0]
                slopes[o, 1, 9] = fy * there[1]
            if width > 10:
                slopes[o, 0, 10] = fx * u * r2
                slopes[o, 1, 10] = fy * v * r2
                slopes[o, 0, 11] = fx * u * r2 * r2
                slopes[o, 1, 11] = fy * v * r2 * r2
            if width > 12:
                slopes[o, 0, 12] = ti.f64(1.0)
                slopes[o, 1, 12] = ti.f64(0.0)
                slopes[o, 0, 13] = ti.f64(0.0)
                slopes[o, 1, 13] = ti.f64(1.0)
        else:
            gaps[o, 0] = BEHIND
            gaps[o, 1] = BEHIND
            weights[o] = ti.f64(0.0)
            for j in range(width):
                slopes[o, 0, j] = ti.f64(0.0)
                slopes[o, 1, j] = ti.f64(0.0)


@ti.kernel
def join_costs(
    gaps: f64_2,
    loss: ti.i32,
    scale: ti.f64,
    # outputs
    costs: f64_1,
):
    for n in range(costs.shape[0]):
        joined = ti.f64(0.0)
        if loss == CAUCHY:
            joined = ti.f64(1.0)
        for o in range(n * JOINED, ti.min((n + 1) * JOINED, gaps.shape[0])):
            x = gaps[o, 0]
            y = gaps[o, 1]
            square = x * x + y * y
            if loss == CAUCHY:
                joined = joined * (ti.f64(1.0) + square / (scale * scale))
            else:
                if loss == HUBER:
                    length = ti.sqrt(square)
                    if length > scale:
                        square = scale * (ti.f64(2.0) * length - scale)
                joined = joined + square
        costs[n] = joined
