"""Votes for ellipses on CUDA, one block per pair of points, with its histogram in shared memory.

As on the CPU, a pair of points is taken as the ends of a major axis, and every third point votes
for a minor semi-axis, one thread per third point.
"""

import warp as wp

from cvkern.kernels.codes.hough import MAX_BINS
from cvkern.kernels.warp import _native

from ._bounds import Bounds

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BLOCK = 256  # threads of a block; Warp's own
PAIRS = 1 << 22  # most pairs of one launch, because threads are numbered with 32 bits


@_native.kernel("_votes_cuda.cu", BLOCK=BLOCK, MAX_BINS=MAX_BINS)
def vote_pairs(
    first: int,
    points: wp.array2d[float],  # (4, N)
    bounds: Bounds,
    bins: int,
    # outputs
    votes: wp.array2d[int],  # (N, N)
    axes: wp.array2d[int],  # (N, N)
): ...
