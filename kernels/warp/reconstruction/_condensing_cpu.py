"""The Schur complement of bundle adjustment on the CPU: a row of the blocks of a view at a time.

The Taichi set has the equations. A thread takes parameters of views.
"""

import warp as wp

from cvkern.kernels.codes.reconstruction import Blocks, Condensed, Eliminated, Slopes
from cvkern.kernels.warp._launch import launch_each

from ._sightings import Seen

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

f64 = wp.float64


def condense(
    slopes: Slopes, seen: Seen, eliminated: Eliminated, blocks: Blocks, condensed: Condensed
) -> None:
    """Write the equations; see `adjustment.condense`."""
    count, sightings = condensed.right.size, slopes.weights.size
    inputs = [slopes.slopes, slopes.weights, seen, eliminated.inverses, blocks.number]
    launch_each(_fill_rows, count, 512 * sightings, inputs, [condensed.system])
    inputs = [*slopes, seen, eliminated.pulls]
    launch_each(_gather, count, 64 * sightings, inputs, [*condensed[1:]])


@wp.kernel
def _fill_rows(
    stride: int,
    first: int,
    last: int,
    slopes: wp.array3d[f64],
    weights: wp.array[f64],
    seen: Seen,
    inverses: wp.array2d[f64],
    number: wp.array2d[int],
    # outputs
    system: wp.array3d[f64],
):
    size = system.shape[1]
    for item in range(first + wp.tid(), last, stride):
        c = item // size
        r = item - c * size
        for other in range(c, number.shape[1]):
            b = number[c, other]
            if b >= 0:
                for s in range(size):
                    system[b, r, s] = f64(0.0)
        own = number[c, c]
        for place in range(seen.ranges[c, 0], seen.ranges[c, 0] + seen.ranges[c, 1]):
            o = seen.order[place]
            p = seen.ends[o, 2]
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


@wp.kernel
def _gather(
    stride: int,
    first: int,
    last: int,
    slopes: wp.array3d[f64],
    gaps: wp.array2d[f64],
    weights: wp.array[f64],
    seen: Seen,
    pulls: wp.array2d[f64],
    # outputs
    right: wp.array2d[f64],
    sizes: wp.array2d[f64],
):
    size = right.shape[1]
    for item in range(first + wp.tid(), last, stride):
        c = item // size
        r = item - c * size
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
            x = up * slopes[o, 0, 0] + down * slopes[o, 1, 0]
            y = up * slopes[o, 0, 1] + down * slopes[o, 1, 1]
            z = up * slopes[o, 0, 2] + down * slopes[o, 1, 2]
            gradient -= x * pulls[p, 0] + y * pulls[p, 1] + z * pulls[p, 2]
        right[c, r] = gradient
        sizes[c, r] = diagonal
