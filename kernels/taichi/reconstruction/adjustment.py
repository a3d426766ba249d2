"""Bundle adjustment, in Taichi: residuals, derivatives, and equations without the points.

A view sees the point W at X = R W + t, in the pixel

    x = fx (u s + 2 p1 u v + p2 (r^2 + 2 u^2)) + cx,   s = 1 + k1 r^2 + k2 r^4 + k3 r^6
    y = fy (v s + p1 (r^2 + 2 v^2) + 2 p2 u v) + cy,   u = X / Z, v = Y / Z, r^2 = u^2 + v^2

(D. Brown, 1966, as OpenCV has it). A turn w changes R to exp(w) R. A step of Levenberg and
Marquardt solves the equations of the views without the points, and then moves the points. All
numbers are float64, and sums are in the order of sightings, so results do not depend on the number
of threads.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.reconstruction import (
    BEHIND,
    FLATTEST,
    JOINED,
    NEAREST,
    Blocks,
    Condensed,
    Eliminated,
    Loss,
    Scenery,
    Sightings,
    Slopes,
)
from cvkern.kernels.taichi._launch import primitive

from ._condensing import fill_rows, gather

f64_1 = ti.types.ndarray(dtype=ti.f64, ndim=1)
f64_2 = ti.types.ndarray(dtype=ti.f64, ndim=2)
f64_3 = ti.types.ndarray(dtype=ti.f64, ndim=3)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
HUBER, CAUCHY = int(Loss.HUBER), int(Loss.CAUCHY)


@primitive
def measure(scenery: Scenery, sightings: Sightings, gaps: np.ndarray) -> None:
    """Find the residuals, in pixels; one thread a sighting."""
    _measure(*scenery, sightings.where, sightings.ends, gaps)


@primitive
def linearise(
    scenery: Scenery, sightings: Sightings, loss: int, scale: float, slopes: Slopes
) -> None:
    """Find residuals, their weights under a loss, and derivatives; one thread a sighting."""
    _linearise(*scenery, sightings.where, sightings.ends, loss, scale, *slopes)


@primitive
def eliminate(slopes: Slopes, sightings: Sightings, damping: float, eliminated: Eliminated) -> None:
    """Invert the equations of each point, its diagonal 1 + damping times as large.

    One thread a point.
    """
    _eliminate(*slopes, sightings.spans, damping, *eliminated)


@primitive
def condense(
    slopes: Slopes,
    sightings: Sightings,
    eliminated: Eliminated,
    blocks: Blocks,
    condensed: Condensed,
) -> None:
    """Write the equations of the views without points; one thread a parameter of a view."""
    fill_rows(
        slopes.slopes, slopes.weights, *sightings[1:], eliminated.inverses, blocks.number,
        condensed.system,
    )  # fmt: skip
    gather(
        *slopes, sightings.ends, sightings.order, sightings.ranges, eliminated.pulls,
        *condensed[1:],
    )  # fmt: skip


@primitive
def substitute(
    slopes: Slopes,
    sightings: Sightings,
    eliminated: Eliminated,
    steps: np.ndarray,
    points: np.ndarray,
    moved: np.ndarray,
) -> None:
    """Move the points (P, 3) as it goes with the steps (C, K) of the views; one thread a point."""
    _substitute(
        slopes.slopes, slopes.weights, sightings.ends, sightings.spans, *eliminated, steps, points,
        moved,
    )  # fmt: skip


@primitive
def join_costs(gaps: np.ndarray, loss: int, scale: float, costs: np.ndarray) -> None:
    """Join the costs of `JOINED` residuals each to a number; see `codes.reconstruction.JOINED`.

    Costs are twice r^2 / 2 and so on, before Cauchy's logarithm. One thread a number.
    """
    _join_costs(gaps, loss, scale, costs)


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
def _measure(
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
def _linearise(
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
def _eliminate(
    slopes: f64_3,
    gaps: f64_2,
    weights: f64_1,
    spans: i32_2,
    damping: ti.f64,
    # outputs
    inverses: f64_2,
    pulls: f64_2,
):
    for p in range(pulls.shape[0]):
        xx = ti.f64(0.0)
        xy = ti.f64(0.0)
        xz = ti.f64(0.0)
        yy = ti.f64(0.0)
        yz = ti.f64(0.0)
        zz = ti.f64(0.0)
        gx = ti.f64(0.0)
        gy = ti.f64(0.0)
        gz = ti.f64(0.0)
        for o in range(spans[p, 0], spans[p, 0] + spans[p, 1]):
            w = weights[o]
            for k in range(2):
                x = slopes[o, k, 0]
                y = slopes[o, k, 1]
                z = slopes[o, k, 2]
                gap = gaps[o, k]
                xx += w * (x * x)
                xy += w * (x * y)
                xz += w * (x * z)
                yy += w * (y * y)
                yz += w * (y * z)
                zz += w * (z * z)
                gx += w * (x * gap)
                gy += w * (y * gap)
                gz += w * (z * gap)
        xx = xx * (ti.f64(1.0) + damping) + FLATTEST
        yy = yy * (ti.f64(1.0) + damping) + FLATTEST
        zz = zz * (ti.f64(1.0) + damping) + FLATTEST
        # The adjugate over the determinant.
        a = yy * zz - yz * yz
        b = xz * yz - xy * zz
        c = xy * yz - xz * yy
        determinant = xx * a + xy * b + xz * c
        scale = ti.f64(0.0)
        if determinant > ti.f64(0.0):
            scale = ti.f64(1.0) / determinant
        ia = scale * a
        ib = scale * b
        ic = scale * c
        jd = scale * (xx * zz - xz * xz)
        ie = scale * (xy * xz - xx * yz)
        ig = scale * (xx * yy - xy * xy)
        inverses[p, 0] = ia
        inverses[p, 1] = ib
        inverses[p, 2] = ic
        inverses[p, 3] = jd
        inverses[p, 4] = ie
        inverses[p, 5] = ig
        pulls[p, 0] = ia * gx + ib * gy + ic * gz
        pulls[p, 1] = ib * gx + jd * gy + ie * gz
        pulls[p, 2] = ic * gx + ie * gy + ig * gz


@ti.kernel
def _substitute(
    slopes: f64_3,
    weights: f64_1,
    ends: i32_2,
    spans: i32_2,
    inverses: f64_2,
    pulls: f64_2,
    steps: f64_2,
    points: f64_2,
    # outputs
    moved: f64_2,
):
    for p in range(moved.shape[0]):
        x = ti.f64(0.0)
        y = ti.f64(0.0)
        z = ti.f64(0.0)
        for o in range(spans[p, 0], spans[p, 0] + spans[p, 1]):
            c = ends[o, 0]
            for k in range(2):
                change = ti.f64(0.0)
                for s in range(steps.shape[1]):
                    change += slopes[o, k, 3 + s] * steps[c, s]
                change = weights[o] * change
                x += slopes[o, k, 0] * change
                y += slopes[o, k, 1] * change
                z += slopes[o, k, 2] * change
        moved[p, 0] = points[p, 0] - (
            pulls[p, 0] + (inverses[p, 0] * x + inverses[p, 1] * y + inverses[p, 2] * z)
        )
        moved[p, 1] = points[p, 1] - (
            pulls[p, 1] + (inverses[p, 1] * x + inverses[p, 3] * y + inverses[p, 4] * z)
        )
        moved[p, 2] = points[p, 2] - (
            pulls[p, 2] + (inverses[p, 2] * x + inverses[p, 4] * y + inverses[p, 5] * z)
        )


@ti.kernel
def _join_costs(
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
