"""Points along lines, cut into runs at gaps, in Taichi; one thread per point or run.

Positions along a line are float64 with rounded products, so their bits are the same on every
device.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.hough import DENSITY, DIRECTIONS, FARTHEST, PARTIAL, PLACES
from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi._rounding import wide_product
from cvkern.kernels.taichi.hough._directions import direction_code

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f64_1 = ti.types.ndarray(dtype=ti.f64, ndim=1)
f64_2 = ti.types.ndarray(dtype=ti.f64, ndim=2)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
i64_1 = ti.types.ndarray(dtype=ti.i64, ndim=1)
u8_1 = ti.types.ndarray(dtype=ti.u8, ndim=1)


@ti.kernel
def _prepare(
    points: f32_2,
    directions: f32_1,
    parts: ti.f64,
    zero: ti.i32,
    # outputs
    fixed: i32_2,
    codes: i32_1,
):
    for i in codes:
        for k in ti.static(range(2)):
            at = wide_product(ti.cast(points[i, k], ti.f64), parts, zero)
            fixed[i, k] = ti.cast(ti.floor(at + ti.cast(0.5, ti.f64)), ti.i32)
        codes[i] = direction_code(directions[i], zero)


@primitive
def prepare(
    points: np.ndarray, directions: np.ndarray, parts: float, fixed: np.ndarray, codes: np.ndarray
) -> None:
    """Round points to fixed point, and directions to their codes."""
    _prepare(points, directions, parts, 0, fixed, codes)


@ti.func
def _along(
    points: ti.template(), i: ti.i32, lines: ti.template(), k: ti.i32, zero: ti.i32
) -> ti.f64:
    y = wide_product(ti.cast(points[i, 0], ti.f64), lines[0, k], zero)
    return y - wide_product(ti.cast(points[i, 1], ti.f64), lines[1, k], zero)


@ti.kernel
def _place(
    points: f32_2,
    codes: i32_1,
    labels: i32_1,
    lines: f64_2,
    normals: i32_1,
    zero: ti.i32,
    # outputs
    keys: i64_1,
    order: i32_1,
    along: f64_1,
):
    for i in labels:
        group = 2 * lines.shape[1]
        at = ti.cast(0.0, ti.f64)
        label = labels[i]
        if label < lines.shape[1]:
            at = _along(points, i, lines, label, zero)
            # A gradient is along the normal, or against it.
            group = 2 * label
            turned = (codes[i] - normals[label] + DIRECTIONS // 4) & (DIRECTIONS - 1)
            if turned < DIRECTIONS // 2:
                group += 1
        along[i] = at
        steps = wide_product(at + ti.cast(FARTHEST, ti.f64), ti.cast(PLACES, ti.f64), zero)
        step = ti.cast(ti.floor(steps + ti.cast(0.5, ti.f64)), ti.i64)
        keys[i] = (ti.cast(group, ti.i64) << ti.cast(32, ti.i64)) + step
        order[i] = i


@ti.kernel
def _merge(
    keys: i64_1,
    order: i32_1,
    width: ti.i32,
    number: ti.i32,
    # outputs
    merged_keys: i64_1,
    merged: i32_1,
):
    """Merge neighbouring sorted parts of `width`: each element finds its place in the other one."""
    for i in range(number):
        part = i // width
        first = (part + 1 - 2 * (part % 2)) * width  # place of the other part
        low = ti.min(first, number)
        high = ti.min(first + width, number)
        begin = low
        while low < high:
            middle = (low + high) // 2
            # Equal keys stay in their order: those of the left part come first.
            if keys[middle] < keys[i] or (keys[middle] == keys[i] and part % 2 == 1):
                low = middle + 1
            else:
                high = middle
        place = i - part * width + (low - begin) + part // 2 * 2 * width
        merged_keys[place] = keys[i]
        merged[place] = order[i]


@ti.kernel
def _flag(
    keys: i64_1,
    order: i32_1,
    along: f64_1,
    none: ti.i32,
    max_gap: ti.f64,
    # outputs
    ranks: i32_1,
):
    for j in ranks:
        begins = 1
        if j > 0:
            group = ti.cast(keys[j] >> ti.cast(32, ti.i64), ti.i32)
            begins = 0
            if group != ti.cast(keys[j - 1] >> ti.cast(32, ti.i64), ti.i32):
                begins = 1
            elif group != none and along[order[j]] - along[order[j - 1]] > max_gap:
                begins = 1
        ranks[j] = begins


@ti.kernel
def _add(
    # outputs
    counts: i32_1,
):
    ti.loop_config(serialize=True)
    for i in range(1, counts.shape[0]):
        counts[i] = counts[i] + counts[i - 1]


@ti.kernel
def _begin(
    ranks: i32_1,
    # outputs
    begins: i32_1,
):
    for j in ranks:
        before = 0
        if j > 0:
            before = ranks[j - 1]
        if ranks[j] != before:
            begins[ranks[j] - 1] = j
        if j == ranks.shape[0] - 1:
            begins[ranks[j]] = j + 1


@ti.kernel
def _choose(
    keys: i64_1,
    order: i32_1,
    along: f64_1,
    ranks: i32_1,
    begins: i32_1,
    none: ti.i32,
    least: ti.f64,
    density: ti.f64,
    zero: ti.i32,
    # outputs
    places: i32_1,
):
    for r in places:
        kept = 0
        if r < ranks[ranks.shape[0] - 1]:
            begin = begins[r]
            end = begins[r + 1]
            length = along[order[end - 1]] - along[order[begin]]
            group = ti.cast(keys[begin] >> ti.cast(32, ti.i64), ti.i32)
            needed = wide_product(density, length, zero)
            if group != none and length >= least and ti.cast(end - begin, ti.f64) >= needed:
                kept = 1
        places[r] = kept


@ti.kernel
def _mark(
    order: i32_1,
    ranks: i32_1,
    begins: i32_1,
    places: i32_1,
    # outputs
    runs: i32_2,
    chosen: u8_1,
    total: i32_1,
):
    for j in ranks:
        run = ranks[j] - 1
        before = 0
        if run > 0:
            before = places[run - 1]
        kept = places[run] - before
        if kept == 1 and begins[run] == j:
            runs[before, 0] = j
            runs[before, 1] = begins[run + 1] - j
        chosen[order[j]] = ti.cast(kept, ti.u8)
        if j == ranks.shape[0] - 1:
            total[0] = places[run]


@primitive
def cut(
    points: np.ndarray,
    codes: np.ndarray,
    labels: np.ndarray,
    lines: np.ndarray,
    normals: np.ndarray,
    limits: tuple[float, float],
    order: np.ndarray,
    runs: np.ndarray,
    chosen: np.ndarray,
    total: np.ndarray,
) -> None:
    """Sort points along their lines, cut them at gaps, and list the long and dense runs.

    `lines` are cosines and sines, (2, K), and `limits` the largest gap and the least length. Points
    of both sides of a line are apart. `order` has 2 N elements; only the first half is a result.
    """
    max_gap, least = limits
    number, none = points.shape[0], 2 * lines.shape[1]
    keys, other_keys = (scratch((2 * number,), np.int64) for _ in range(2))
    other = scratch((2 * number,), np.int32)
    along = scratch((number,), np.float64)
    ranks, places = (scratch((number,), np.int32) for _ in range(2))
    begins = scratch((number + 1,), np.int32)
    steps = max(number - 1, 1).bit_length()
    lists = [(keys, order), (other_keys, other)]
    if steps % 2:  # the last step must fill `order`
        lists.reverse()
    _place(points, codes, labels, lines, normals, 0, *lists[0], along)
    for step in range(steps):
        _merge(*lists[0], 1 << step, number, *lists[1])
        lists.reverse()
    _flag(keys, order, along, none, max_gap, ranks)
    _add(ranks)
    _begin(ranks, begins)
    _choose(keys, order, along, ranks, begins, none, least, DENSITY, 0, places)
    _add(places)
    _mark(order, ranks, begins, places, runs, chosen, total)


@ti.kernel
def _add_up(
    points: f32_2,
    directions: f32_1,
    order: i32_1,
    runs: i32_2,
    zero: ti.i32,
    # outputs
    partial: ti.types.ndarray(dtype=ti.f64, ndim=3),
    sums: f64_2,
):
    for run in range(sums.shape[0]):
        begin = runs[run, 0]
        origin = order[begin]
        for lane in range(PARTIAL):
            for k in ti.static(range(5)):
                partial[run, lane, k] = 0.0
        for j in range(begin, begin + runs[run, 1]):
            lane = (j - begin) % PARTIAL
            y = ti.cast(points[order[j], 0], ti.f64) - ti.cast(points[origin, 0], ti.f64)
            x = ti.cast(points[order[j], 1], ti.f64) - ti.cast(points[origin, 1], ti.f64)
            partial[run, lane, 0] += y
            partial[run, lane, 1] += x
            partial[run, lane, 2] += wide_product(y, y, zero)
            partial[run, lane, 3] += wide_product(x, x, zero)
            partial[run, lane, 4] += wide_product(y, x, zero)
        half = PARTIAL // 2
        while half > 0:
            for lane in range(half):
                for k in ti.static(range(5)):
                    partial[run, lane, k] += partial[run, lane + half, k]
            half = half // 2
        for k in ti.static(range(5)):
            sums[run, 3 + k] = partial[run, 0, k]
        sums[run, 0] = points[origin, 0]
        sums[run, 1] = points[origin, 1]
        sums[run, 2] = directions[origin]


@primitive
def add_up(
    points: np.ndarray,
    directions: np.ndarray,
    order: np.ndarray,
    runs: np.ndarray,
    sums: np.ndarray,
) -> None:
    """Add up rows and columns, their squares and products, from the first point of each run.

    Before these sums, `sums` (S, 8) has row, column and direction of the first point. `PARTIAL`
    sums take the points in turn, and are then added in pairs.
    """
    partial = scratch((sums.shape[0], PARTIAL, 5), np.float64)
    _add_up(points, directions, order, runs, 0, partial, sums)


@ti.kernel
def _reach(
    points: f32_2,
    order: i32_1,
    runs: i32_2,
    lines: f64_2,
    zero: ti.i32,
    # outputs
    ends: f64_2,
):
    for run in range(ends.shape[0]):
        least = ti.cast(FARTHEST, ti.f64)
        most = -least
        for j in range(runs[run, 0], runs[run, 0] + runs[run, 1]):
            at = _along(points, order[j], lines, run, zero)
            least = ti.min(least, at)
            most = ti.max(most, at)
        ends[run, 0] = least
        ends[run, 1] = most


@primitive
def reach(
    points: np.ndarray, order: np.ndarray, runs: np.ndarray, lines: np.ndarray, ends: np.ndarray
) -> None:
    """Find the least and the largest place of each run along its line; one thread per run."""
    _reach(points, order, runs, lines, 0, ends)


@ti.kernel
def _hold(
    labels: i32_1,
    chosen: u8_1,
    # outputs
    after: i32_1,
):
    for i in after:
        after[i] = labels[i] * ti.cast(chosen[i], ti.i32) - 1


@primitive
def hold(labels: np.ndarray, chosen: np.ndarray, after: np.ndarray) -> None:
    """Return the label that a point has to come after: a point of a run keeps its line."""
    _hold(labels, chosen, after)


@ti.kernel
def _keep(
    points: f32_2,
    directions: f32_1,
    chosen: u8_1,
    # outputs
    left_points: f32_2,
    left_directions: f32_1,
    total: i32_1,
):
    total[0] = 0
    ti.loop_config(serialize=True)
    for i in range(chosen.shape[0]):
        if chosen[i] == 0:
            n = total[0]
            left_points[n, 0] = points[i, 0]
            left_points[n, 1] = points[i, 1]
            left_directions[n] = directions[i]
            total[0] = n + 1


@primitive
def keep(
    points: np.ndarray,
    directions: np.ndarray,
    chosen: np.ndarray,
    left_points: np.ndarray,
    left_directions: np.ndarray,
    total: np.ndarray,
) -> None:
    """List the points that are in no run, in their order; one thread."""
    _keep(points, directions, chosen, left_points, left_directions, total)
