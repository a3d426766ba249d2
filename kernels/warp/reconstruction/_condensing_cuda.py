"""Equations of the views without points, on CUDA: a thread a number of a block.

A block has the parameters of a view by those of another. The points that both see are found by
going through the sightings of both in the order of the points. All sums have the order of the CPU.
"""

import warp as wp

from cvkern.kernels.codes.reconstruction import Blocks, Condensed, Eliminated, Slopes
from cvkern.kernels.warp._launch import launch

from ._sightings import Seen

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

f64 = wp.float64
WARP = 32


def condense(
    slopes: Slopes, seen: Seen, eliminated: Eliminated, blocks: Blocks, condensed: Condensed
) -> None:
    """Write the equations; see `adjustment.condense`."""
    size = condensed.right.shape[1]
    # The threads of a block are whole warps, which go through its sightings together.
    threads = -(-size * size // WARP) * WARP
    inputs = [*slopes, seen, *eliminated]
    count = blocks.views.shape[0] * threads
    launch(_fill_blocks, count, [*inputs, blocks.views, threads], [condensed.system], threads)
    launch(_gather, condensed.right.size, inputs, [*condensed[1:]], WARP)


@wp.kernel
def _fill_blocks(
    slopes: wp.array3d[f64],
    gaps: wp.array2d[f64],
    weights: wp.array[f64],
    seen: Seen,
    inverses: wp.array2d[f64],
    pulls: wp.array2d[f64],
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
    if r < size:
        c = views[b, 0]
        d = views[b, 1]
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
                w = weights[o]
                up = w * slopes[o, 0, 3 + r]
                down = w * slopes[o, 1, 3 + r]
                if c == d:
                    total = total + (up * slopes[o, 0, 3 + s] + down * slopes[o, 1, 3 + s])
                x = up * slopes[o, 0, 0] + down * slopes[o, 1, 0]
                y = up * slopes[o, 0, 1] + down * slopes[o, 1, 1]
                z = up * slopes[o, 0, 2] + down * slopes[o, 1, 2]
                i = inverses[p, 0] * x + inverses[p, 1] * y + inverses[p, 2] * z
                j = inverses[p, 1] * x + inverses[p, 3] * y + inverses[p, 4] * z
                k = inverses[p, 2] * x + inverses[p, 4] * y + inverses[p, 5] * z
                up = weights[q] * (slopes[q, 0, 0] * i + slopes[q, 0, 1] * j + slopes[q, 0, 2] * k)
                down = weights[q] * (
                    slopes[q, 1, 0] * i + slopes[q, 1, 1] * j + slopes[q, 1, 2] * k
                )
                total = total - (up * slopes[q, 0, 3 + s] + down * slopes[q, 1, 3 + s])
            if p <= p2:
                here += 1
            if p2 <= p:
                there += 1
        system[b, r, s] = total


@wp.kernel
def _gather(
    slopes: wp.array3d[f64],
    gaps: wp.array2d[f64],
    weights: wp.array[f64],
    seen: Seen,
    inverses: wp.array2d[f64],
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
