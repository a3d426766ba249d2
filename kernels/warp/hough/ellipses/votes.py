"""Votes for ellipses, in Warp."""

import warp as wp

from cvkern.kernels.warp._launch import cpu_threads, launch, launch_slabs, scratch

from . import _votes_cpu as cpu
from . import _votes_cuda as cuda

_SLABS = 16  # a thread: the later of two points has more before it
_SLAB_TRIPLES = 1 << 20


def vote_pairs(
    points: wp.array,
    least: float,
    most: float,
    narrow: float,
    wide: float,
    per_bin: float,
    bins: int,
    turn: float,
    votes: wp.array,
    axes: wp.array,
) -> None:
    """Find, for each pair of points, the minor semi-axis that most third points agree on.

    `points` are rows, columns, and sines and cosines of directions, (4, N). The squared distance
    of a pair is in [least, most], the square of the minor semi-axis in [narrow, wide], its bin the
    nearest whole number of `per_bin` times it. Directions count unless `turn`, the square of the
    sine that they may be off by, is negative. `votes` and `axes`, the bin, are (N, N), and 0 but
    for pairs whose second point comes before the first.
    """
    count = points.shape[1]
    directed = turn >= 0
    if points.device.is_cuda:
        inputs = [points, least, most, narrow, wide, per_bin, bins, directed, turn]
        pairs = min(count * count, cuda.PAIRS)
        for first in range(0, count * count, pairs):
            launch(cuda.vote_pairs, pairs * cuda.BLOCK, [first, *inputs], [votes, axes])
        return
    slabs = min(_SLABS * cpu_threads(), count) if count**3 >= _SLAB_TRIPLES else 1
    histograms = scratch("pairs.histograms", (slabs, bins + 1), wp.int32, points.device)
    inputs = [points, least, most, narrow, wide, per_bin, directed, turn, histograms]
    launch_slabs(cpu.vote_pairs, count, slabs, inputs, [votes, axes])
