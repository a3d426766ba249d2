"""Bundle adjustment, in Warp: residuals, derivatives, and equations without the points.

A view sees the point W at X = R W + t, in the pixel

    x = fx (u s + 2 p1 u v + p2 (r^2 + 2 u^2)) + cx,   s = 1 + k1 r^2 + k2 r^4 + k3 r^6
    y = fy (v s + p1 (r^2 + 2 v^2) + 2 p2 u v) + cy,   u = X / Z, v = Y / Z, r^2 = u^2 + v^2

(D. Brown, 1966, as OpenCV has it). A turn w changes R to exp(w) R. A step of Levenberg and
Marquardt solves the equations of the views without the points, and then moves the points. All
numbers are float64, and sums are in the order of sightings, so results do not depend on the number
of threads.
codes/reconstruction.py says what the rows and columns of each array are.
"""

import warp as wp

from cvkern.kernels.codes import reconstruction as codes
from cvkern.kernels.codes.reconstruction import (
    Blocks,
    Condensed,
    Eliminated,
    Loss,
    Scenery,
    Sightings,
    Slopes,
)
from cvkern.kernels.warp._launch import launch_each
from cvkern.kernels.warp._structs import struct_of

from . import _condensing_cpu as cpu
from . import _condensing_cuda as cuda
from ._projection import bent, radial, turned
from ._sightings import Seen

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

f64 = wp.float64
NEAREST = wp.constant(f64(codes.NEAREST))
BEHIND = wp.constant(f64(codes.BEHIND))
FLATTEST = wp.constant(f64(codes.FLATTEST))

JOINED = wp.constant(codes.JOINED)
HUBER = wp.constant(int(Loss.HUBER))
CAUCHY = wp.constant(int(Loss.CAUCHY))


@wp.struct
class Cast:
    """Cameras and points; see `codes.reconstruction.Scenery`."""

    views: wp.array2d[f64]
    lenses: wp.array2d[f64]
    points: wp.array2d[f64]


def measure(scenery: Scenery, sightings: Sightings, gaps: wp.array) -> None:
    """Find the residuals, in pixels; one thread a sighting."""
    inputs = [struct_of(Cast, scenery), sightings.where, sightings.ends]
    launch_each(_measure, gaps.shape[0], 64 * gaps.shape[0], inputs, [gaps])


def linearise(
    scenery: Scenery, sightings: Sightings, loss: int, scale: float, slopes: Slopes
) -> None:
    """Find residuals, their weights under a loss, and derivatives; one thread a sighting."""
    count = slopes.weights.size
    inputs = [struct_of(Cast, scenery), sightings.where, sightings.ends, loss, scale]
    launch_each(_linearise, count, 128 * count, inputs, [*slopes])


def eliminate(slopes: Slopes, sightings: Sightings, damping: float, eliminated: Eliminated) -> None:
    """Invert the equations of each point, its diagonal 1 + damping times as large.

    One thread a point.
    """
    count = eliminated.pulls.shape[0]
    inputs = [*slopes, sightings.spans, damping]
    launch_each(_eliminate, count, 64 * slopes.weights.size, inputs, [*eliminated])


def condense(
    slopes: Slopes,
    sightings: Sightings,
    eliminated: Eliminated,
    blocks: Blocks,
    condensed: Condensed,
) -> None:
    """Write the equations of the views without points.

    On the CPU, a thread takes a parameter of a view. On CUDA it takes a number of a block.
    """
    seen = struct_of(Seen, sightings[1:])
    if condensed.right.device.is_cuda:
        cuda.condense(slopes, seen, eliminated, blocks, condensed)
    else:
        cpu.condense(slopes, seen, eliminated, blocks, condensed)


def substitute(
    slopes: Slopes,
    sightings: Sightings,
    eliminated: Eliminated,
    steps: wp.array,
    points: wp.array,
    moved: wp.array,
) -> None:
    """Move the points (P, 3) as it goes with the steps (C, K) of the views; one thread a point."""
    inputs = [
        slopes.slopes, slopes.weights, sightings.ends, sightings.spans, *eliminated, steps, points
    ]  # fmt: skip
    launch_each(_substitute, moved.shape[0], 64 * slopes.weights.size, inputs, [moved])


def join_costs(gaps: wp.array, loss: int, scale: float, costs: wp.array) -> None:
    """Join the costs of `JOINED` residuals each to a number; see `codes.reconstruction.JOINED`.

    Costs are twice r^2 / 2 and so on, before Cauchy's logarithm. One thread a number.
    """
    count = costs.shape[0]
    launch_each(_join_costs, count, 8 * gaps.shape[0], [gaps, loss, scale], [costs])


@wp.kernel
def _measure(
    stride: int,
    first: int,
    last: int,
    cast: Cast,
    where: wp.array2d[f64],
    ends: wp.array2d[int],
    # outputs
    gaps: wp.array2d[f64],
):
    for o in range(first + wp.tid(), last, stride):
        c = ends[o, 0]
        n = ends[o, 1]
        q = turned(cast.views, c, cast.points, ends[o, 2])
        z = q[2] + cast.views[c, 11]
        gaps[o, 0] = BEHIND
        gaps[o, 1] = BEHIND
        if z > NEAREST:
            there = bent(
                cast.lenses, n, (q[0] + cast.views[c, 9]) / z, (q[1] + cast.views[c, 10]) / z
            )
            gaps[o, 0] = cast.lenses[n, 0] * there[0] + cast.lenses[n, 2] - where[o, 0]
            gaps[o, 1] = cast.lenses[n, 1] * there[1] + cast.lenses[n, 3] - where[o, 1]


@wp.kernel
def _linearise(
    stride: int,
    first: int,
    last: int,
    cast: Cast,
    where: wp.array2d[f64],
    ends: wp.array2d[int],
    loss: int,
    scale: f64,
    # outputs
    slopes: wp.array3d[f64],
    gaps: wp.array2d[f64],
    weights: wp.array[f64],
):
    width = slopes.shape[2]
    for o in range(first + wp.tid(), last, stride):
        c = ends[o, 0]
        n = ends[o, 1]
        q = turned(cast.views, c, cast.points, ends[o, 2])
        z = q[2] + cast.views[c, 11]
        if z > NEAREST:
            u = (q[0] + cast.views[c, 9]) / z
            v = (q[1] + cast.views[c, 10]) / z
            there = bent(cast.lenses, n, u, v)
            fx = cast.lenses[n, 0]
            fy = cast.lenses[n, 1]
            dx = fx * there[0] + cast.lenses[n, 2] - where[o, 0]
            dy = fy * there[1] + cast.lenses[n, 3] - where[o, 1]
            gaps[o, 0] = dx
            gaps[o, 1] = dy
            square = dx * dx + dy * dy
            weight = f64(1.0)
            if loss == HUBER:
                if square > scale * scale:
                    weight = scale / wp.sqrt(square)
            elif loss == CAUCHY:
                weight = f64(1.0) / (f64(1.0) + square / (scale * scale))
            weights[o] = weight
            # Derivatives of the bent place, which are symmetric, over the depth.
            r2 = u * u + v * v
            k1 = cast.lenses[n, 4]
            k2 = cast.lenses[n, 5]
            p1 = cast.lenses[n, 6]
            p2 = cast.lenses[n, 7]
            grown = radial(cast.lenses, n, r2)
            steep = f64(2.0) * (k1 + r2 * (f64(2.0) * k2 + f64(3.0) * cast.lenses[n, 8] * r2))
            xx = (grown + steep * u * u + f64(2.0) * p1 * v + f64(6.0) * p2 * u) / z
            xy = (steep * u * v + f64(2.0) * p1 * u + f64(2.0) * p2 * v) / z
            yy = (grown + steep * v * v + f64(6.0) * p1 * v + f64(2.0) * p2 * u) / z
            for k in range(2):
                a = wp.where(k == 0, fx * xx, fy * xy)
                b = wp.where(k == 0, fx * xy, fy * yy)
                d = -(a * u + b * v)
                for j in range(3):
                    slopes[o, k, j] = (
                        a * cast.views[c, j] + b * cast.views[c, 3 + j] + d * cast.views[c, 6 + j]
                    )
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
                slopes[o, 0, 12] = f64(1.0)
                slopes[o, 1, 12] = f64(0.0)
                slopes[o, 0, 13] = f64(0.0)
                slopes[o, 1, 13] = f64(1.0)
        else:
            gaps[o, 0] = BEHIND
            gaps[o, 1] = BEHIND
            weights[o] = f64(0.0)
            for j in range(width):
                slopes[o, 0, j] = f64(0.0)
                slopes[o, 1, j] = f64(0.0)


@wp.kernel
def _eliminate(
    stride: int,
    first: int,
    last: int,
    slopes: wp.array3d[f64],
    gaps: wp.array2d[f64],
    weights: wp.array[f64],
    spans: wp.array2d[int],
    damping: f64,
    # outputs
    inverses: wp.array2d[f64],
    pulls: wp.array2d[f64],
):
    for p in range(first + wp.tid(), last, stride):
        xx = f64(0.0)
        xy = f64(0.0)
        xz = f64(0.0)
        yy = f64(0.0)
        yz = f64(0.0)
        zz = f64(0.0)
        gx = f64(0.0)
        gy = f64(0.0)
        gz = f64(0.0)
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
        xx = xx * (f64(1.0) + damping) + FLATTEST
        yy = yy * (f64(1.0) + damping) + FLATTEST
        zz = zz * (f64(1.0) + damping) + FLATTEST
        # The adjugate over the determinant.
        a = yy * zz - yz * yz
        b = xz * yz - xy * zz
        c = xy * yz - xz * yy
        determinant = xx * a + xy * b + xz * c
        scale = f64(0.0)
        if determinant > f64(0.0):
            scale = f64(1.0) / determinant
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


@wp.kernel
def _substitute(
    stride: int,
    first: int,
    last: int,
    slopes: wp.array3d[f64],
    weights: wp.array[f64],
    ends: wp.array2d[int],
    spans: wp.array2d[int],
    inverses: wp.array2d[f64],
    pulls: wp.array2d[f64],
    steps: wp.array2d[f64],
    points: wp.array2d[f64],
    # outputs
    moved: wp.array2d[f64],
):
    for p in range(first + wp.tid(), last, stride):
        x = f64(0.0)
        y = f64(0.0)
        z = f64(0.0)
        for o in range(spans[p, 0], spans[p, 0] + spans[p, 1]):
            c = ends[o, 0]
            for k in range(2):
                change = f64(0.0)
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


@wp.kernel
def _join_costs(
    stride: int,
    first: int,
    last: int,
    gaps: wp.array2d[f64],
    loss: int,
    scale: f64,
    # outputs
    costs: wp.array[f64],
):
    for n in range(first + wp.tid(), last, stride):
        joined = f64(0.0)
        if loss == CAUCHY:
            joined = f64(1.0)
        for o in range(n * JOINED, wp.min((n + 1) * JOINED, gaps.shape[0])):
            x = gaps[o, 0]
            y = gaps[o, 1]
            square = x * x + y * y
            if loss == CAUCHY:
                joined = joined * (f64(1.0) + square / (scale * scale))
            else:
                if loss == HUBER:
                    length = wp.sqrt(square)
                    if length > scale:
                        square = scale * (f64(2.0) * length - scale)
                joined = joined + square
        costs[n] = joined
