"""Bundle adjustment, in Taichi: residuals, derivatives, and equations without the points.

A view sees a point W at X = R W + t; a turn w changes R to exp(w) R. All numbers are float64, and
sums are in the order of sightings, so results do not depend on the number of threads.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.reconstruction import (
    FLATTEST,
    Blocks,
    Condensed,
    Eliminated,
    Scenery,
    Sightings,
    Slopes,
)
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi.reconstruction import _residuals as residuals

f64_1 = ti.types.ndarray(dtype=ti.f64, ndim=1)
f64_2 = ti.types.ndarray(dtype=ti.f64, ndim=2)
f64_3 = ti.types.ndarray(dtype=ti.f64, ndim=3)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)


@primitive
def measure(scenery: Scenery, sightings: Sightings, gaps: np.ndarray) -> None:
    """Find the residuals, in pixels; one thread a sighting."""
    residuals.measure(*scenery, sightings.where, sightings.ends, gaps)


@primitive
def linearise(
    scenery: Scenery, sightings: Sightings, loss: int, scale: float, slopes: Slopes
) -> None:
    """Find residuals, their weights under a loss, and derivatives; one thread a sighting."""
    residuals.linearise(*scenery, sightings.where, sightings.ends, loss, scale, *slopes)


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
    where = sightings.ends, sightings.order, sightings.ranges
    _condense(
        slopes.slopes, slopes.weights, *where, sightings.spans, eliminated.inverses,
        blocks.number, condensed.system,
    )  # fmt: skip
    _gather(*slopes, *where, eliminated.pulls, condensed.right, condensed.sizes)


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
    residuals.join_costs(gaps, loss, scale, costs)


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
def _condense(
    slopes: f64_3,
    weights: f64_1,
    ends: i32_2,
    order: i32_1,
    ranges: i32_2,
    spans: i32_2,
    inverses: f64_2,
    number: i32_2,
    # outputs
    system: f64_3,
):
    size = system.shape[1]
    for item in range(ranges.shape[0] * size):
        c = item // size
        r = item - c * size
        for other in range(c, ranges.shape[0]):
            b = number[c, other]
            if b >= 0:
                for s in range(size):
                    system[b, r, s] = ti.f64(0.0)
        own = number[c, c]
        for place in range(ranges[c, 0], ranges[c, 0] + ranges[c, 1]):
            o = order[place]
            p = ends[o, 2]
            w = weights[o]
            up = w * slopes[o, 0, 3 + r]
            down = w * slopes[o, 1, 3 + r]
            for s in range(size):
                here = up * slopes[o, 0, 3 + s] + down * slopes[o, 1, 3 + s]
                system[own, r, s] = system[own, r, s] + here
            x = up * slopes[o, 0, 0] + down * slopes[o, 1, 0]
            y = up * slopes[o, 0, 1] + down * slopes[o, 1, 1]
            z = up * slopes[o, 0, 2] + down * slopes[o, 1, 2]
            i = inverses[p, 0] * x + inverses[p, 1] * y + inverses[p, 2] * z
            j = inverses[p, 1] * x + inverses[p, 3] * y + inverses[p, 4] * z
            k = inverses[p, 2] * x + inverses[p, 4] * y + inverses[p, 5] * z
            for q in range(spans[p, 0], spans[p, 0] + spans[p, 1]):
                d = ends[q, 0]
                if d >= c:
                    b = number[c, d]
                    up = weights[q] * (
                        slopes[q, 0, 0] * i + slopes[q, 0, 1] * j + slopes[q, 0, 2] * k
                    )
                    down = weights[q] * (
                        slopes[q, 1, 0] * i + slopes[q, 1, 1] * j + slopes[q, 1, 2] * k
                    )
                    for s in range(size):
                        there = up * slopes[q, 0, 3 + s] + down * slopes[q, 1, 3 + s]
                        system[b, r, s] = system[b, r, s] - there


@ti.kernel
def _gather(
    slopes: f64_3,
    gaps: f64_2,
    weights: f64_1,
    ends: i32_2,
    order: i32_1,
    ranges: i32_2,
    pulls: f64_2,
    # outputs
    right: f64_2,
    sizes: f64_2,
):
    for c, r in right:
        gradient = ti.f64(0.0)
        diagonal = ti.f64(0.0)
        for place in range(ranges[c, 0], ranges[c, 0] + ranges[c, 1]):
            o = order[place]
            p = ends[o, 2]
            up = weights[o] * slopes[o, 0, 3 + r]
            down = weights[o] * slopes[o, 1, 3 + r]
            gradient += up * gaps[o, 0] + down * gaps[o, 1]
            diagonal += up * slopes[o, 0, 3 + r] + down * slopes[o, 1, 3 + r]
            x = up * slopes[o, 0, 0] + down * slopes[o, 1, 0]
            y = up * slopes[o, 0, 1] + down * slopes[o, 1, 1]
            z = up * slopes[o, 0, 2] + down * slopes[o, 1, 2]
            gradient -= x * pulls[p, 0] + y * pulls[p, 1] + z * pulls[p, 2]
        right[c, r] = gradient
        sizes[c, r] = diagonal


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
