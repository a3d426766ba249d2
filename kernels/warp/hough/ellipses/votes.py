"""Votes for ellipses, in Warp: a thread takes a slab of points (CPU), a block takes a pair (CUDA).

A pair of points is taken as the ends of a major axis, and every third point votes for a minor
semi-axis; _third_point.h has the equation and its source.
"""

import warp as wp

from cvkern.kernels.codes.hough import EllipseBounds
from cvkern.kernels.warp._launch import cpu_threads, launch, launch_slabs, scratch
from cvkern.kernels.warp._structs import struct_of

from . import _votes_cpu as cpu
from . import _votes_cuda as cuda
from ._bounds import Bounds

_SLABS = 16  # slabs per thread, because later points have more points before them
_SLAB_TRIPLES = 1 << 20  # triples of points that are worth a second thread


def vote_pairs(
    points: wp.array, bounds: EllipseBounds, bins: int, votes: wp.array, axes: wp.array
) -> None:
    """Find, for each pair of points, the minor semi-axis that most third points agree on.

    `points` are rows, columns, and sines and cosines of directions, (4, N). `votes` and `axes` (the
    bins) are (N, N), and 0 except for pairs whose second point precedes the first.
    """
    count = points.shape[1]
    given = struct_of(Bounds, bounds)
    if points.device.is_cuda:
        pairs = min(count * count, cuda.PAIRS)
        for first in range(0, count * count, pairs):
            inputs = [first, points, given, bins]
            launch(cuda.vote_pairs, pairs * cuda.BLOCK, inputs, [votes, axes])
        return
    slabs = min(_SLABS * cpu_threads(), count) if count**3 >= _SLAB_TRIPLES else 1
    histograms = scratch("pairs.histograms", (slabs, bins + 1), wp.int32, points.device)
    launch_slabs(cpu.vote_pairs, count, slabs, [points, given, histograms], [votes, axes])
