"""Points along lines, cut into runs at gaps, on the CPU: by one thread, or a thread a slab of runs.

Positions along a line are float64 without fused multiply-adds, so they have the same bits on every
device.
"""

import warp as wp

from cvkern.kernels.codes.hough import DIRECTIONS, FARTHEST, PARTIAL, PLACES
from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

LANES = wp.constant(PARTIAL)
DIGIT = 9  # bits of a place that are sorted at a time
BEFORE = wp.constant(wp.float64(FARTHEST))
f64_lanes = wp.types.vector(PARTIAL, wp.float64)


@wp.func
def total_of(lanes: f64_lanes) -> wp.float64:
    """Add the upper half to the lower, until one is left."""
    sums = lanes
    half = LANES // 2
    while half > 0:
        for k in range(half):
            sums[k] = sums[k] + sums[k + half]
        half = half // 2
    return sums[0]


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


@wp.kernel
def add_up(
    stride: int,
    first: int,
    last: int,
    points: wp.array2d[float],  # (N, 2)
    directions: wp.array[float],  # (N,)
    order: wp.array[int],
    runs: wp.array2d[int],  # (S, 2)
    # outputs
    sums: wp.array2d[
        wp.float64
    ],  # (S, 8): row, column and direction of the first point, and the sums
):
    # Add in the order of _runs.py: every 32nd point, then the upper half of the sums to the lower.
    for run in range(first + wp.tid(), last, stride):
        begin = runs[run, 0]
        origin = order[begin]
        top = wp.float64(points[origin, 0])
        left = wp.float64(points[origin, 1])
        down = f64_lanes()
        along = f64_lanes()
        squares_down = f64_lanes()
        squares_along = f64_lanes()
        products = f64_lanes()
        for j in range(runs[run, 1]):
            point = order[begin + j]
            y = wp.float64(points[point, 0]) - top
            x = wp.float64(points[point, 1]) - left
            lane = j % LANES
            down[lane] = down[lane] + y
            along[lane] = along[lane] + x
            squares_down[lane] = squares_down[lane] + y * y
            squares_along[lane] = squares_along[lane] + x * x
            products[lane] = products[lane] + y * x
        sums[run, 0] = top
        sums[run, 1] = left
        sums[run, 2] = wp.float64(directions[origin])
        sums[run, 3] = total_of(down)
        sums[run, 4] = total_of(along)
        sums[run, 5] = total_of(squares_down)
        sums[run, 6] = total_of(squares_along)
        sums[run, 7] = total_of(products)


@wp.kernel
def reach(
    stride: int,
    first: int,
    last: int,
    points: wp.array2d[float],
    order: wp.array[int],
    runs: wp.array2d[int],
    lines: wp.array2d[wp.float64],  # (2, S)
    # outputs
    ends: wp.array2d[wp.float64],  # (S, 2)
):
    for run in range(first + wp.tid(), last, stride):
        least = BEFORE
        most = -BEFORE
        for j in range(runs[run, 0], runs[run, 0] + runs[run, 1]):
            y = wp.float64(points[order[j], 0])
            x = wp.float64(points[order[j], 1])
            at = y * lines[0, run] - x * lines[1, run]
            least = wp.min(least, at)
            most = wp.max(most, at)
        ends[run, 0] = least
        ends[run, 1] = most


@wp.kernel
def keep(
    points: wp.array2d[float],
    directions: wp.array[float],
    chosen: wp.array[wp.uint8],
    # outputs
    left_points: wp.array2d[float],
    left_directions: wp.array[float],
    total: wp.array[int],
):
    place = int(0)
    for i in range(chosen.shape[0]):
        # Avoid a branch, which could not be predicted.
        left_points[place, 0] = points[i, 0]
        left_points[place, 1] = points[i, 1]
        left_directions[place] = directions[i]
        place += 1 - int(chosen[i])
    total[0] = place
