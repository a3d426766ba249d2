"""The Schur complement of bundle adjustment on CUDA: one thread computes one number of a block.

The Taichi set has the equations. A block S_cd has the parameters of a view by those of another. Its
thread finds the points that both views see by going through the sightings of both at once, which
are in the order of the points. All sums have the order of the CPU.
"""

import warp as wp

from cvkern.kernels.codes.reconstruction import Blocks, Condensed, Eliminated, Slopes
from cvkern.kernels.warp._launch import launch

from ._sightings import Seen

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

f64 = wp.float64
WARP = 32
AT_ONCE = wp.constant(4)  # sightings of one view whose numbers are loaded together


def condense(
    slopes: Slopes, seen: Seen, eliminated: Eliminated, blocks: Blocks, condensed: Condensed
) -> None:
    """Write the equations; see `adjustment.condense`."""
    size = condensed.right.shape[1]
    # The threads of a block are whole warps, which go through its sightings together.
    threads = -(-size * size // WARP) * WARP
    inputs = [slopes.slopes, slopes.weights, seen, eliminated.inverses]
    count = blocks.views.shape[0] * threads
    launch(_fill_blocks, count, [*inputs, blocks.views, threads], [condensed.system], threads)
    own = condensed.right.shape[0] * threads
    launch(_fill_own, own, [*inputs, blocks.number, threads], [condensed.system], threads)
    inputs = [*slopes, seen, eliminated.pulls]
    launch(_gather, condensed.right.size, inputs, [*condensed[1:]], WARP)


@wp.func
def ahead(
    slopes: wp.array3d[f64],
    weights: wp.array[f64],
    inverses: wp.array2d[f64],
    o: int,
    p: int,
    r: int,
) -> wp.vec3d:
    """Return V_p^-1 w A^T b for sighting `o` of point `p`, where b is column `r` of B."""
    w = weights[o]
    up = w * slopes[o, 0, 3 + r]
    down = w * slopes[o, 1, 3 + r]
    x = up * slopes[o, 0, 0] + down * slopes[o, 1, 0]
    y = up * slopes[o, 0, 1] + down * slopes[o, 1, 1]
    z = up * slopes[o, 0, 2] + down * slopes[o, 1, 2]
    return wp.vec3d(
        inverses[p, 0] * x + inverses[p, 1] * y + inverses[p, 2] * z,
        inverses[p, 1] * x + inverses[p, 3] * y + inverses[p, 4] * z,
        inverses[p, 2] * x + inverses[p, 4] * y + inverses[p, 5] * z,
    )


@wp.func
def back(slopes: wp.array3d[f64], weights: wp.array[f64], q: int, s: int, i: wp.vec3d) -> f64:
    """Return w b^T A i for sighting `q`: b is column `s` of its B, and `i` comes from `ahead`."""
    w = weights[q]
    up = w * (slopes[q, 0, 0] * i[0] + slopes[q, 0, 1] * i[1] + slopes[q, 0, 2] * i[2])
    down = w * (slopes[q, 1, 0] * i[0] + slopes[q, 1, 1] * i[1] + slopes[q, 1, 2] * i[2])
    return up * slopes[q, 0, 3 + s] + down * slopes[q, 1, 3 + s]


@wp.kernel
def _fill_blocks(
    slopes: wp.array3d[f64],
    weights: wp.array[f64],
    seen: Seen,
    inverses: wp.array2d[f64],
    views: wp.array2d[int],
    threads: int,
    # outputs
    system: wp.array3d[f64],
):
    b = wp.tid() // threads
    size = system.shape[1]
    item = wp.tid() - b * threads
    r = item // size
    s = item - r * size
    c = views[b, 0]
    d = views[b, 1]
    if r < size and c != d:
        total = f64(0.0)
        here = seen.ranges[c, 0]
        there = seen.ranges[d, 0]
        here_end = here + seen.ranges[c, 1]
        there_end = there + seen.ranges[d, 1]
        while here < here_end and there < there_end:
            o = seen.order[here]
            q = seen.order[there]
            p = seen.ends[o, 2]
            p2 = seen.ends[q, 2]
            if p == p2:
                total = total - back(
                    slopes, weights, q, s, ahead(slopes, weights, inverses, o, p, r)
                )
            if p <= p2:
                here += 1
            if p2 <= p:
                there += 1
        system[b, r, s] = total


@wp.func
def own_part(
    slopes: wp.array3d[f64],
    weights: wp.array[f64],
    inverses: wp.array2d[f64],
    seen: Seen,
    place: int,
    r: int,
    s: int,
) -> wp.vec2d:
    """Return both terms of a sighting in the block of its view with itself: w B^T B, and V's."""
    o = seen.order[place]
    p = seen.ends[o, 2]
    w = weights[o]
    up = w * slopes[o, 0, 3 + r]
    down = w * slopes[o, 1, 3 + r]
    return wp.vec2d(
        up * slopes[o, 0, 3 + s] + down * slopes[o, 1, 3 + s],
        back(slopes, weights, o, s, ahead(slopes, weights, inverses, o, p, r)),
    )


@wp.kernel
def _fill_own(
    slopes: wp.array3d[f64],
    weights: wp.array[f64],
    seen: Seen,
    inverses: wp.array2d[f64],
    number: wp.array2d[int],
    threads: int,
    # outputs
    system: wp.array3d[f64],
):
    c = wp.tid() // threads
    size = system.shape[1]
    item = wp.tid() - c * threads
    r = item // size
    s = item - r * size
    if r < size:
        total = f64(0.0)
        begin = seen.ranges[c, 0]
        count = seen.ranges[c, 1]
        whole = count // AT_ONCE
        for n in range(whole):
            # Loads of several sightings do not wait for each other.
            place = begin + n * AT_ONCE
            a = own_part(slopes, weights, inverses, seen, place, r, s)
            b = own_part(slopes, weights, inverses, seen, place + 1, r, s)
            d = own_part(slopes, weights, inverses, seen, place + 2, r, s)
            e = own_part(slopes, weights, inverses, seen, place + 3, r, s)
            total = total + a[0] - a[1] + b[0] - b[1] + d[0] - d[1] + e[0] - e[1]
        for n in range(whole * AT_ONCE, count):
            a = own_part(slopes, weights, inverses, seen, begin + n, r, s)
            total = total + a[0] - a[1]
        system[number[c, c], r, s] = total


@wp.func
def gradient_part(
    slopes: wp.array3d[f64],
    gaps: wp.array2d[f64],
    weights: wp.array[f64],
    pulls: wp.array2d[f64],
    seen: Seen,
    place: int,
    r: int,
) -> wp.vec3d:
    """Return the three numbers of a sighting that gradient and diagonal sum."""
    o = seen.order[place]
    p = seen.ends[o, 2]
    w = weights[o]
    up = w * slopes[o, 0, 3 + r]
    down = w * slopes[o, 1, 3 + r]
    x = up * slopes[o, 0, 0] + down * slopes[o, 1, 0]
    y = up * slopes[o, 0, 1] + down * slopes[o, 1, 1]
    z = up * slopes[o, 0, 2] + down * slopes[o, 1, 2]
    return wp.vec3d(
        up * gaps[o, 0] + down * gaps[o, 1],
        x * pulls[p, 0] + y * pulls[p, 1] + z * pulls[p, 2],
        up * slopes[o, 0, 3 + r] + down * slopes[o, 1, 3 + r],
    )


@wp.kernel
def _gather(
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
    c = wp.tid() // size
    r = wp.tid() - c * size
    gradient = f64(0.0)
    diagonal = f64(0.0)
    begin = seen.ranges[c, 0]
    count = seen.ranges[c, 1]
    whole = count // AT_ONCE
    for n in range(whole):
        place = begin + n * AT_ONCE
        a = gradient_part(slopes, gaps, weights, pulls, seen, place, r)
        b = gradient_part(slopes, gaps, weights, pulls, seen, place + 1, r)
        d = gradient_part(slopes, gaps, weights, pulls, seen, place + 2, r)
        e = gradient_part(slopes, gaps, weights, pulls, seen, place + 3, r)
        gradient = gradient + a[0] - a[1] + b[0] - b[1] + d[0] - d[1] + e[0] - e[1]
        diagonal = diagonal + a[2] + b[2] + d[2] + e[2]
    for n in range(whole * AT_ONCE, count):
        a = gradient_part(slopes, gaps, weights, pulls, seen, begin + n, r)
        gradient = gradient + a[0] - a[1]
        diagonal = diagonal + a[2]
    right[c, r] = gradient
    sizes[c, r] = diagonal
