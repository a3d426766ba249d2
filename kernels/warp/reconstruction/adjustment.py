"""Bundle adjustment, in Warp: residuals, derivatives, and equations without the points.

A view sees a point W at X = R W + t; a turn w changes R to exp(w) R. All numbers are float64, and
sums are in the order of sightings, so results do not depend on the number of threads.
codes/reconstruction.py says what the rows and columns of each array are.
"""

import warp as wp

from cvkern.kernels.codes import reconstruction as codes
from cvkern.kernels.codes.reconstruction import (
    Blocks,
    Condensed,
    Eliminated,
    Scenery,
    Sightings,
    Slopes,
)
from cvkern.kernels.warp._launch import launch_each
from cvkern.kernels.warp._structs import struct_of

from . import _condensing_cuda as cuda
from . import _residuals as residuals
from ._sightings import Seen

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

f64 = wp.float64
FLATTEST = wp.constant(f64(codes.FLATTEST))


@wp.struct
class Rest:
    """What is left of the equations of points; see `codes.reconstruction.Eliminated`."""

    inverses: wp.array2d[f64]
    pulls: wp.array2d[f64]


def measure(scenery: Scenery, sightings: Sightings, gaps: wp.array) -> None:
    """Find the residuals, in pixels; one thread a sighting."""
    inputs = [struct_of(residuals.Cast, scenery), sightings.where, sightings.ends]
    launch_each(residuals.measure, gaps.shape[0], 64 * gaps.shape[0], inputs, [gaps])


def linearise(
    scenery: Scenery, sightings: Sightings, loss: int, scale: float, slopes: Slopes
) -> None:
    """Find residuals, their weights under a loss, and derivatives; one thread a sighting."""
    count = slopes.weights.size
    inputs = [struct_of(residuals.Cast, scenery), sightings.where, sightings.ends, loss, scale]
    launch_each(residuals.linearise, count, 128 * count, inputs, [*slopes])


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
        return
    count = condensed.right.size
    inputs = [*slopes, seen, struct_of(Rest, eliminated), blocks.number]
    launch_each(_condense, count, 512 * slopes.weights.size, inputs, [*condensed])


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
    launch_each(residuals.join_costs, count, 8 * gaps.shape[0], [gaps, loss, scale], [costs])


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
def _condense(
    stride: int,
    first: int,
    last: int,
    slopes: wp.array3d[f64],
    gaps: wp.array2d[f64],
    weights: wp.array[f64],
    seen: Seen,
    rest: Rest,
    number: wp.array2d[int],
    # outputs
    system: wp.array3d[f64],
    right: wp.array2d[f64],
    sizes: wp.array2d[f64],
):
    size = right.shape[1]
    for item in range(first + wp.tid(), last, stride):
        c = item // size
        r = item - c * size
        for other in range(c, right.shape[0]):
            b = number[c, other]
            if b >= 0:
                for s in range(size):
                    system[b, r, s] = f64(0.0)
        own = number[c, c]
        gradient = f64(0.0)
        diagonal = f64(0.0)
        for place in range(seen.ranges[c, 0], seen.ranges[c, 0] + seen.ranges[c, 1]):
            o = seen.order[place]
            p = seen.ends[o, 2]
            w = weights[o]
            up = w * slopes[o, 0, 3 + r]
            down = w * slopes[o, 1, 3 + r]
            gradient += up * gaps[o, 0] + down * gaps[o, 1]
            diagonal += up * slopes[o, 0, 3 + r] + down * slopes[o, 1, 3 + r]
            for s in range(size):
                here = up * slopes[o, 0, 3 + s] + down * slopes[o, 1, 3 + s]
                system[own, r, s] = system[own, r, s] + here
            x = up * slopes[o, 0, 0] + down * slopes[o, 1, 0]
            y = up * slopes[o, 0, 1] + down * slopes[o, 1, 1]
            z = up * slopes[o, 0, 2] + down * slopes[o, 1, 2]
            gradient -= x * rest.pulls[p, 0] + y * rest.pulls[p, 1] + z * rest.pulls[p, 2]
            i = rest.inverses[p, 0] * x + rest.inverses[p, 1] * y + rest.inverses[p, 2] * z
            j = rest.inverses[p, 1] * x + rest.inverses[p, 3] * y + rest.inverses[p, 4] * z
            k = rest.inverses[p, 2] * x + rest.inverses[p, 4] * y + rest.inverses[p, 5] * z
            for q in range(seen.spans[p, 0], seen.spans[p, 0] + seen.spans[p, 1]):
                d = seen.ends[q, 0]
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
        right[c, r] = gradient
        sizes[c, r] = diagonal


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
