"""Residuals of bundle adjustment, their derivatives and their costs: a thread a sighting.

adjustment.py has the equations, and codes/reconstruction.py what the columns of each array are.
"""

import warp as wp

from cvkern.kernels.codes import reconstruction as codes
from cvkern.kernels.codes.reconstruction import Loss

from ._projection import bent, radial, turned

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

f64 = wp.float64
NEAREST = wp.constant(f64(codes.NEAREST))
BEHIND = wp.constant(f64(codes.BEHIND))
JOINED = wp.constant(codes.JOINED)
HUBER = wp.constant(int(Loss.HUBER))
CAUCHY = wp.constant(int(Loss.CAUCHY))


@wp.struct
class Cast:
    """Cameras and points; see `codes.reconstruction.Scenery`."""

    views: wp.array2d[f64]
    lenses: wp.array2d[f64]
    points: wp.array2d[f64]


@wp.kernel
def measure(
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
def linearise(
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
def join_costs(
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
