"""Points along lines, cut into runs at gaps, by one thread per point or run on CUDA.

On the CPU, _runs_cpu.py has in one what several kernels do here one after the other; only `prepare`
and `hold` run there too.
Positions along a line are float64 without fused multiply-adds, so they have the same bits on every
device.
"""

import warp as wp

from cvkern.kernels.codes.hough import DIRECTIONS, FARTHEST, PARTIAL, PLACES
from cvkern.kernels.warp.hough._directions import direction_code

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "default_grid_stride": False})

QUARTER = wp.constant(DIRECTIONS // 4)
LAST = wp.constant(DIRECTIONS - 1)
SUMS = 5  # sums of a run: rows, columns, squares of both, products
NUMBER_OF_SUMS = wp.constant(SUMS)
LANES = wp.constant(PARTIAL)
BEFORE = wp.constant(wp.float64(FARTHEST))
STEPS = wp.constant(wp.float64(PLACES))
HALF = wp.constant(wp.float64(0.5))


@wp.kernel
def prepare(
    stride: int,
    first: int,
    last: int,
    points: wp.array2d[float],  # (N, 2)
    directions: wp.array[float],  # (N,)
    parts: wp.float64,
    # outputs
    fixed: wp.array2d[int],  # (N, 2)
    codes: wp.array[int],  # (N,)
):
    for i in range(first + wp.tid(), last, stride):
        for k in range(2):
            fixed[i, k] = int(wp.floor(wp.float64(points[i, k]) * parts + HALF))
        codes[i] = direction_code(directions[i])


@wp.kernel
def place(
    stride: int,
    first: int,
    last: int,
    points: wp.array2d[float],  # (N, 2)
    codes: wp.array[int],  # (N,)
    labels: wp.array[int],  # (N,)
    lines: wp.array2d[wp.float64],  # (2, K): cosine, sine
    normals: wp.array[int],  # (K,)
    # outputs
    keys: wp.array[wp.int64],  # (2 N,): group, then place along the line
    order: wp.array[int],  # (2 N,)
    along: wp.array[wp.float64],  # (N,)
):
    lines_all = lines.shape[1]
    for i in range(first + wp.tid(), last, stride):
        label = labels[i]
        group = 2 * lines_all
        at = wp.float64(0.0)
        if label < lines_all:
            y = wp.float64(points[i, 0])
            x = wp.float64(points[i, 1])
            at = y * lines[0, label] - x * lines[1, label]
            # A gradient is along the normal, or against it.
            group = 2 * label
            if ((codes[i] - normals[label] + QUARTER) & LAST) < 2 * QUARTER:
                group += 1
        along[i] = at
        steps = wp.int64(wp.floor((at + BEFORE) * STEPS + HALF))
        keys[i] = (wp.int64(group) << wp.int64(32)) + steps
        order[i] = i


@wp.kernel
def gather(
    stride: int,
    first: int,
    last: int,
    keys: wp.array[wp.int64],
    order: wp.array[int],
    along: wp.array[wp.float64],
    none: int,  # the group of points that are on no line
    max_gap: wp.float64,
    # outputs
    sorted: wp.array[wp.float64],  # (N,)
    ranks: wp.array[int],  # (N,): 1 where a run begins
):
    for j in range(first + wp.tid(), last, stride):
        at = along[order[j]]
        group = int(keys[j] >> wp.int64(32))
        begins = j == 0
        if j > 0:
            before = int(keys[j - 1] >> wp.int64(32))
            begins = group != before
            if group == before and group != none:
                begins = at - along[order[j - 1]] > max_gap
        sorted[j] = at
        ranks[j] = int(begins)


@wp.kernel
def begin_runs(
    stride: int,
    first: int,
    last: int,
    ranks: wp.array[int],  # (N,): number of runs that have begun
    # outputs
    begins: wp.array[int],  # (N + 1,)
):
    for j in range(first + wp.tid(), last, stride):
        here = ranks[j]
        before = int(0)
        if j > 0:
            before = ranks[j - 1]
        if here != before:
            begins[here - 1] = j
        if j == ranks.shape[0] - 1:
            begins[here] = j + 1


@wp.kernel
def choose(
    stride: int,
    first: int,
    last: int,
    keys: wp.array[wp.int64],
    sorted: wp.array[wp.float64],
    ranks: wp.array[int],
    begins: wp.array[int],
    none: int,
    least: wp.float64,
    density: wp.float64,
    # outputs
    places: wp.array[int],  # (N,): 1 where a run is kept
):
    for r in range(first + wp.tid(), last, stride):
        kept = int(0)
        if r < ranks[ranks.shape[0] - 1]:
            begin = begins[r]
            end = begins[r + 1]
            length = sorted[end - 1] - sorted[begin]
            group = int(keys[begin] >> wp.int64(32))
            if group != none and length >= least:
                kept = int(wp.float64(end - begin) >= density * length)
        places[r] = kept


@wp.kernel
def mark(
    stride: int,
    first: int,
    last: int,
    order: wp.array[int],
    ranks: wp.array[int],
    begins: wp.array[int],
    places: wp.array[int],  # (N,): number of runs kept up to this one
    # outputs
    runs: wp.array2d[int],  # (N, 2): where a run begins, and its number of points
    chosen: wp.array[wp.uint8],  # (N,)
    total: wp.array[int],  # (1,)
):
    for j in range(first + wp.tid(), last, stride):
        run = ranks[j] - 1
        place = places[run]
        before = int(0)
        if run > 0:
            before = places[run - 1]
        kept = place - before
        if kept == 1 and begins[run] == j:
            runs[before, 0] = j
            runs[before, 1] = begins[run + 1] - j
        chosen[order[j]] = wp.uint8(kept)
        if j == ranks.shape[0] - 1:
            total[0] = place


@wp.kernel
def add_up(
    stride: int,
    first: int,
    last: int,
    points: wp.array2d[float],
    order: wp.array[int],
    runs: wp.array2d[int],
    # outputs
    partial: wp.array3d[wp.float64],  # (S, LANES, SUMS)
):
    # Lane k adds the points k, k + LANES and so on of its run, in this order.
    for i in range(first + wp.tid(), last, stride):
        run = i // LANES
        lane = i - run * LANES
        begin = runs[run, 0]
        end = begin + runs[run, 1]
        origin = order[begin]
        down = wp.float64(0.0)
        along = wp.float64(0.0)
        squares_down = wp.float64(0.0)
        squares_along = wp.float64(0.0)
        products = wp.float64(0.0)
        for j in range(begin + lane, end, LANES):
            y = wp.float64(points[order[j], 0]) - wp.float64(points[origin, 0])
            x = wp.float64(points[order[j], 1]) - wp.float64(points[origin, 1])
            down += y
            along += x
            squares_down += y * y
            squares_along += x * x
            products += y * x
        partial[run, lane, 0] = down
        partial[run, lane, 1] = along
        partial[run, lane, 2] = squares_down
        partial[run, lane, 3] = squares_along
        partial[run, lane, 4] = products


@wp.kernel
def finish(
    stride: int,
    first: int,
    last: int,
    points: wp.array2d[float],
    directions: wp.array[float],
    order: wp.array[int],
    runs: wp.array2d[int],
    # outputs
    partial: wp.array3d[wp.float64],
    sums: wp.array2d[wp.float64],  # (S, 3 + SUMS): row, column and direction of the first point
):
    for i in range(first + wp.tid(), last, stride):
        run = i // NUMBER_OF_SUMS
        k = i - run * NUMBER_OF_SUMS
        half = LANES // 2
        while half > 0:
            for lane in range(half):
                partial[run, lane, k] = partial[run, lane, k] + partial[run, lane + half, k]
            half = half // 2
        sums[run, 3 + k] = partial[run, 0, k]
        if k == 0:
            origin = order[runs[run, 0]]
            sums[run, 0] = wp.float64(points[origin, 0])
            sums[run, 1] = wp.float64(points[origin, 1])
            sums[run, 2] = wp.float64(directions[origin])


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
    partial: wp.array3d[wp.float64],  # (S, LANES, 2)
):
    for i in range(first + wp.tid(), last, stride):
        run = i // LANES
        lane = i - run * LANES
        begin = runs[run, 0]
        end = begin + runs[run, 1]
        least = BEFORE
        most = -BEFORE
        for j in range(begin + lane, end, LANES):
            y = wp.float64(points[order[j], 0])
            x = wp.float64(points[order[j], 1])
            at = y * lines[0, run] - x * lines[1, run]
            least = wp.min(least, at)
            most = wp.max(most, at)
        partial[run, lane, 0] = least
        partial[run, lane, 1] = most


@wp.kernel
def join(
    stride: int,
    first: int,
    last: int,
    partial: wp.array3d[wp.float64],  # (S, LANES, 2)
    # outputs
    ends: wp.array2d[wp.float64],  # (S, 2)
):
    for run in range(first + wp.tid(), last, stride):
        least = BEFORE
        most = -BEFORE
        for lane in range(LANES):
            least = wp.min(least, partial[run, lane, 0])
            most = wp.max(most, partial[run, lane, 1])
        ends[run, 0] = least
        ends[run, 1] = most


@wp.kernel
def hold(
    stride: int,
    first: int,
    last: int,
    labels: wp.array[int],
    chosen: wp.array[wp.uint8],
    # outputs
    after: wp.array[int],
):
    for i in range(first + wp.tid(), last, stride):
        after[i] = labels[i] * int(chosen[i]) - 1


@wp.kernel
def count_left(
    stride: int,
    first: int,
    last: int,
    chosen: wp.array[wp.uint8],
    # outputs
    places: wp.array[int],
):
    for i in range(first + wp.tid(), last, stride):
        places[i] = 1 - int(chosen[i])


@wp.kernel
def keep(
    stride: int,
    first: int,
    last: int,
    points: wp.array2d[float],
    directions: wp.array[float],
    places: wp.array[int],  # (N,): number of points kept up to this one
    # outputs
    left_points: wp.array2d[float],
    left_directions: wp.array[float],
    total: wp.array[int],
):
    for i in range(first + wp.tid(), last, stride):
        place = places[i]
        before = int(0)
        if i > 0:
            before = places[i - 1]
        if place != before:
            left_points[before, 0] = points[i, 0]
            left_points[before, 1] = points[i, 1]
            left_directions[before] = directions[i]
        if i == places.shape[0] - 1:
            total[0] = place
