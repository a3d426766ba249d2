"""Votes for ellipses on the CPU, one thread per slab of first points.

A pair of points is taken as the ends of a major axis, and every third point votes for a minor
semi-axis (Xie and Ji, "A new efficient ellipse detection method", ICPR 2002). _third_point.h has
the equation.
"""

import warp as wp

from cvkern.kernels.warp import _native

from ._bounds import Bounds

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@_native.kernel("_votes_cpu.h")
def vote_pairs(
    slab: int,
    first: int,
    last: int,
    points: wp.array2d[float],  # (4, N)
    bounds: Bounds,
    # scratch
    histograms: wp.array2d[int],  # (slabs, bins + 1)
    # outputs
    votes: wp.array2d[int],  # (N, N)
    axes: wp.array2d[int],  # (N, N)
): ...
