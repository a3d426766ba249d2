"""The line that a point belongs to, on CUDA: one thread per point, which stops at its first line.

A point (y, x) is on a line if ``|x cos + y sin - rho|`` is at most a distance and its direction is
within a tolerance of the line's. A block of threads first lists the lines near each tile, and a
point tests those of its tile alone.
"""

import warp as wp

from cvkern.kernels.codes.hough import DIRECTIONS
from cvkern.kernels.warp._launch import BLOCK
from cvkern.kernels.warp._ranks_cuda import count_in_block, rank_in_block

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

HALF_TURN = wp.constant(DIRECTIONS // 2)
THREADS = wp.constant(BLOCK)
TILES = 32  # tiles along a side, whose places are those of the largest row or column
ACROSS = wp.constant(TILES)
# Half a diagonal of a tile is sqrt(1/2) of a side. Points that are outside belong to the next tile;
# they are at most a pixel or two away. Rounding errors are below 2^-20 of a place.
DIAGONAL = wp.constant(0.7072)
BEYOND = wp.constant(4.0)


@wp.kernel
def find_extent(
    points: wp.array2d[float],  # (N, 2)
    # outputs
    extent: wp.array[int],  # (1,): 0 before
):
    i = wp.tid()
    largest = int(wp.max(points[i, 0], points[i, 1]))
    if largest > extent[0]:
        wp.atomic_max(extent, 0, largest)


@wp.func
def side_of(extent: wp.array[int]) -> int:
    """Return the side of a tile, in pixels."""
    return extent[0] // ACROSS + 1


@wp.kernel
def find_near(
    lines: wp.array2d[float],  # (3, K): cosine, sine, rho
    distance: float,
    extent: wp.array[int],
    # outputs
    near: wp.array2d[int],  # (T, K): the lines that pass each tile, ascending
    counts: wp.array[int],  # (T,)
):
    t = wp.tid() // THREADS
    thread = wp.tid() - t * THREADS
    side = float(side_of(extent))
    row = t // ACROSS
    y = (float(row) + 0.5) * side
    x = (float(t - row * ACROSS) + 0.5) * side
    reach = distance + DIAGONAL * side + BEYOND
    total = int(0)
    for begin in range(0, lines.shape[1], THREADS):
        k = begin + thread
        passes = int(0)
        if k < lines.shape[1]:
            if wp.abs((x * lines[0, k] + y * lines[1, k]) - lines[2, k]) <= reach:
                passes = 1
        before = rank_in_block(passes)
        if passes == 1:
            near[t, total + before] = k
        total += count_in_block(passes)
    if thread == 0:
        counts[t] = total


@wp.kernel
def claim(
    points: wp.array2d[float],  # (N, 2)
    codes: wp.array[int],  # (N,)
    after: wp.array[int],  # (N,)
    lines: wp.array2d[float],  # (3, K): cosine, sine, rho
    directions: wp.array[int],  # (K,)
    distance: float,
    tolerance: int,
    extent: wp.array[int],
    near: wp.array2d[int],  # (T, K)
    counts: wp.array[int],  # (T,)
    # outputs
    labels: wp.array[int],  # (N,)
):
    i = wp.tid()
    y = points[i, 0]
    x = points[i, 1]
    code = codes[i]
    side = side_of(extent)
    row = wp.clamp(int(y) // side, 0, ACROSS - 1)
    t = row * ACROSS + wp.clamp(int(x) // side, 0, ACROSS - 1)
    # The first line of the list after `after`.
    n = int(0)
    last = counts[t]
    high = last
    while n < high:
        middle = (n + high) // 2
        if near[t, middle] <= after[i]:
            n = middle + 1
        else:
            high = middle
    label = lines.shape[1]
    while n < last:
        k = near[t, n]
        turn = (code - directions[k]) & (HALF_TURN - 1)
        angle = wp.min(turn, HALF_TURN - turn)
        away = wp.abs((x * lines[0, k] + y * lines[1, k]) - lines[2, k])
        n += 1
        if away <= distance and angle <= tolerance:
            label = k
            n = last
    labels[i] = label
