"""Points along lines, cut into runs at gaps, on the CPU by one thread.

Positions along a line are float64 without fused multiply-adds, so they have the same bits on every
device.
"""

import warp as wp

from cvkern.kernels.codes.hough import DIRECTIONS, FARTHEST, PLACES
from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

DIGIT = 13  # bits of a place that are sorted at a time


@wp.struct
class Sorting:
    """Points in the order of their lines, their runs, and scratch for the sort."""

    order: wp.array[int]  # (2 N,): the second half has those on no line
    runs: wp.array2d[int]  # (N, 2): where a run begins, and its number of points
    along: wp.array[wp.float64]  # (N,): places along the lines
    groups: wp.array[int]  # (N,): line and side of a point
    pairs: wp.array[wp.uint64]  # (2 N,)
    counts: wp.array[int]  # (2^DIGIT or 2 K, the larger,)


@_native.kernel(
    "_runs_cpu.h",
    QUARTER=DIRECTIONS // 4,
    LAST=DIRECTIONS - 1,
    FARTHEST=FARTHEST,
    PLACES=PLACES,
    DIGIT=DIGIT,
)
def cut(
    slab: int,
    first: int,
    last: int,
    points: wp.array2d[float],  # (N, 2)
    codes: wp.array[int],  # (N,)
    labels: wp.array[int],  # (N,)
    lines: wp.array2d[wp.float64],  # (2, K): cosine, sine
    normals: wp.array[int],  # (K,)
    limits: wp.vec3d,  # largest gap, least length, least density
    sorting: Sorting,
    # outputs
    chosen: wp.array[wp.uint8],  # (N,)
    total: wp.array[int],  # (1,)
): ...
