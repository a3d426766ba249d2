"""Robust fits to matches in Taichi: one thread a group of hypotheses, a lane of a sum, or a model.

The order of arithmetic is that of kernels/warp/geometry/_robust.h. `zero` is always 0.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.geometry import (
    COST_ONE,
    DRAWS,
    FLAT,
    GROUP,
    LANES,
    NO_COST,
    PREVIEW,
    SUMS,
    Model,
)
from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi._random import random_index
from cvkern.kernels.taichi._rounding import product, quotient, wide_product

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
f64_2 = ti.types.ndarray(dtype=ti.f64, ndim=2)
f64_3 = ti.types.ndarray(dtype=ti.f64, ndim=3)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
u8_1 = ti.types.ndarray(dtype=ti.u8, ndim=1)

f32x9 = ti.types.vector(9, ti.f32)
f64x4 = ti.types.vector(4, ti.f64)
f64x9 = ti.types.vector(9, ti.f64)
i32x4 = ti.types.vector(4, ti.i32)

SIMILARITY, AFFINE, HOMOGRAPHY = (int(m) for m in Model)
SINGULAR = 1e-13  # pivots below this share of the trace fix no model


@ti.func
def _area(x: f64x4, y: f64x4, a: ti.i32, b: ti.i32, c: ti.i32, zero: ti.i32) -> ti.f64:
    """Return twice the area of a triangle."""
    one = wide_product(x[b] - x[a], y[c] - y[a], zero)
    return one - wide_product(y[b] - y[a], x[c] - x[a], zero)


@ti.func
def _barycentric(x: f64x4, y: f64x4, u: f64x4, v: f64x4, scale: f64x4, zero: ti.i32) -> f64x9:
    """Map p to the sum over three points of scale_i a_i(p) q_i."""
    h = f64x9(0.0)
    for i in ti.static(range(3)):
        j, k = ti.static((i + 1) % 3, (i + 2) % 3)
        fixed = wide_product(x[j], y[k], zero) - wide_product(x[k], y[j], zero)
        row = ti.Vector([y[j] - y[k], x[k] - x[j], fixed])
        for c in ti.static(range(3)):
            scaled = wide_product(row[c], scale[i], zero)
            h[c] += wide_product(u[i], scaled, zero)
            h[3 + c] += wide_product(v[i], scaled, zero)
            h[6 + c] += scaled
    return h


@ti.func
def _homography(x: f64x4, y: f64x4, u: f64x4, v: f64x4, flat: ti.f64, zero: ti.i32):
    """Return whether four points fix a homography with all of them before the horizon, and it."""
    s = f64x4(0.0)
    t = f64x4(0.0)
    for i, corners in ti.static(enumerate(((3, 1, 2), (0, 3, 2), (0, 1, 3), (0, 1, 2)))):
        s[i] = _area(x, y, corners[0], corners[1], corners[2], zero)
        t[i] = _area(u, v, corners[0], corners[1], corners[2], zero)
    mirrored = wide_product(s[3], t[3], zero) < 0.0
    found = True
    for i in ti.static(range(4)):
        found = found and ti.abs(s[i]) > flat and ti.abs(t[i]) > flat
        found = found and (wide_product(s[i], t[i], zero) < 0.0) == mirrored
    scale = f64x4(0.0)
    if found:
        for i in ti.static(range(3)):
            scale[i] = t[i] / s[i]
    return found, _barycentric(x, y, u, v, scale, zero)


@ti.func
def _affine(x: f64x4, y: f64x4, u: f64x4, v: f64x4, flat: ti.f64, zero: ti.i32):
    whole = _area(x, y, 0, 1, 2, zero)
    found = ti.abs(whole) > flat and ti.abs(_area(u, v, 0, 1, 2, zero)) > flat
    scale = f64x4(0.0)
    if found:
        scale = f64x4(1.0) / whole
    h = _barycentric(x, y, u, v, scale, zero)
    h[6], h[7], h[8] = 0.0, 0.0, 1.0
    return found, h


@ti.func
def _similarity(x: f64x4, y: f64x4, u: f64x4, v: f64x4, flat: ti.f64, zero: ti.i32):
    dx, dy, du, dv = x[1] - x[0], y[1] - y[0], u[1] - u[0], v[1] - v[0]
    square = wide_product(dx, dx, zero) + wide_product(dy, dy, zero)
    found = square > flat and wide_product(du, du, zero) + wide_product(dv, dv, zero) > flat
    h = f64x9(0.0)
    if found:
        a = (wide_product(dx, du, zero) + wide_product(dy, dv, zero)) / square
        b = (wide_product(dx, dv, zero) - wide_product(dy, du, zero)) / square
        h[0], h[1], h[3], h[4], h[8] = a, -b, b, a, 1.0
        h[2] = u[0] - (wide_product(a, x[0], zero) - wide_product(b, y[0], zero))
        h[5] = v[0] - (wide_product(b, x[0], zero) + wide_product(a, y[0], zero))
    return found, h


@ti.func
def _solve(
    kind: ti.template(),
    matches: f32_2,
    start: ti.i32,
    count: ti.i32,
    seed: ti.i32,
    hypothesis: ti.i32,
    flat: ti.f64,
    zero: ti.i32,
):
    """Return whether the sample of a hypothesis fixes a model, and the model."""
    picked = i32x4(-1)
    found = True
    x, y, u, v = f64x4(0.0), f64x4(0.0), f64x4(0.0), f64x4(0.0)
    for s in ti.static(range(kind + 2)):
        fresh = False
        for n in range(DRAWS):
            if not fresh:
                picked[s] = random_index(seed, 0, hypothesis, s + 8 * n, count)
                fresh = True
                for r in ti.static(range(s)):
                    fresh = fresh and picked[r] != picked[s]
        found = found and fresh
        i = start + picked[s]
        x[s], y[s] = ti.cast(matches[0, i], ti.f64), ti.cast(matches[1, i], ti.f64)
        u[s], v[s] = ti.cast(matches[2, i], ti.f64), ti.cast(matches[3, i], ti.f64)
    solved = False
    h = f64x9(0.0)
    if ti.static(kind == SIMILARITY):
        solved, h = _similarity(x, y, u, v, flat, zero)
    elif ti.static(kind == AFFINE):
        solved, h = _affine(x, y, u, v, flat, zero)
    else:
        solved, h = _homography(x, y, u, v, flat, zero)
    return found and solved, h


@ti.func
def _transfer(h: f32x9, matches: f32_2, i: ti.i32, zero: ti.i32) -> ti.f32:
    """Return the squared distance of H (x, y) from (u, v)."""
    x, y = matches[0, i], matches[1, i]
    w = (product(h[6], x, zero) + product(h[7], y, zero)) + h[8]
    w = quotient(1.0, w, zero)
    px = (product(h[0], x, zero) + product(h[1], y, zero)) + h[2]
    py = (product(h[3], x, zero) + product(h[4], y, zero)) + h[5]
    dx = product(px, w, zero) - matches[2, i]
    dy = product(py, w, zero) - matches[3, i]
    return product(dx, dx, zero) + product(dy, dy, zero)


@ti.func
def _cost(h: f32x9, matches: f32_2, start: ti.i32, count: ti.i32, square: ti.f32, zero: ti.i32):
    """Return the cost of a model over matches in fixed point, and the number of its inliers."""
    scale = quotient(ti.cast(COST_ONE, ti.f32), square, zero)
    cost = 0
    support = 0
    for i in range(start, start + count):
        r = _transfer(h, matches, i, zero)
        if r < square:
            cost += ti.cast(product(r, scale, zero) + 0.5, ti.i32)
            support += 1
        else:
            cost += COST_ONE
    return cost, support


@ti.kernel
def _propose(
    matches: f32_2,
    spans: i32_2,
    squares: f32_1,
    pairs: i32_1,
    kind: ti.template(),
    seed: ti.i32,
    first: ti.i32,
    flat: ti.f64,
    zero: ti.i32,
    # outputs
    models: f32_3,
    costs: i32_2,
):
    for a, g in ti.ndrange(costs.shape[0], costs.shape[1]):
        pair = pairs[a]
        start, count, square = spans[pair, 0], spans[pair, 1], squares[pair]
        best = f32x9(0.0)
        least = NO_COST
        for n in range(GROUP):
            solved, model = _solve(
                kind, matches, start, count, seed, first + g * GROUP + n, flat, zero
            )
            if solved:
                h = ti.cast(model, ti.f32)
                cost, _ = _cost(h, matches, start, ti.min(count, PREVIEW), square, zero)
                if cost < least:
                    least = cost
                    best = h
        if least < NO_COST:
            least, _ = _cost(best, matches, start, count, square, zero)
        costs[a, g] = least
        for i in ti.static(range(9)):
            models[a, g, i] = best[i]


@primitive
def propose(
    matches: np.ndarray,
    spans: np.ndarray,
    squares: np.ndarray,
    pairs: np.ndarray,
    kind: int,
    seed: int,
    first: int,
    models: np.ndarray,
    costs: np.ndarray,
) -> None:
    """Score the best hypothesis of each group on all matches of a pair."""
    _propose(matches, spans, squares, pairs, kind, seed, first, FLAT, 0, models, costs)


@ti.kernel
def _choose(models: f32_3, costs: i32_2, rows: i32_1, chosen: f64_3):
    for i in range(chosen.shape[0]):
        row = rows[i]
        last = ti.cast(-1, ti.i64)
        for rank in range(chosen.shape[1]):
            least = (ti.cast(NO_COST, ti.i64) << 32) + NO_COST
            for group in range(costs.shape[1]):
                key = (ti.cast(costs[row, group], ti.i64) << 32) + group
                if last < key < least:
                    least = key
            found = ti.cast(least & NO_COST, ti.i32)
            for k in range(9):
                chosen[i, rank, k] = 0.0
                if found < costs.shape[1]:
                    chosen[i, rank, k] = ti.cast(models[row, found, k], ti.f64)
            last = least


@primitive
def choose(models: np.ndarray, costs: np.ndarray, rows: np.ndarray, chosen: np.ndarray) -> None:
    """Copy the models of least (cost, group) of each row, in that order, (R, L, 9) float64."""
    _choose(models, costs, rows, chosen)


@ti.kernel
def _judge(
    matches: f32_2,
    spans: i32_2,
    squares: f32_1,
    pairs: i32_1,
    trial: f64_2,
    again: ti.i32,
    zero: ti.i32,
    # outputs
    models: f64_3,
    costs: i32_2,
    supports: i32_2,
):
    """Keep the trial of each model unless it costs more than before by over a sixteenth."""
    for a, rank in ti.ndrange(costs.shape[0], costs.shape[1]):
        pair = pairs[a]
        item = a * costs.shape[1] + rank
        h = f32x9(0.0)
        for i in ti.static(range(9)):
            h[i] = ti.cast(trial[item, i], ti.f32)
        cost, support = _cost(h, matches, spans[pair, 0], spans[pair, 1], squares[pair], zero)
        if not again or cost <= costs[a, rank] + (costs[a, rank] >> 4):
            costs[a, rank] = cost
            supports[a, rank] = support
            for i in range(9):
                models[a, rank, i] = trial[item, i]


@ti.kernel
def _add(
    matches: f32_2,
    spans: i32_2,
    squares: f32_1,
    pairs: i32_1,
    per_pair: ti.i32,
    factor: ti.f32,
    trial: f64_2,
    zero: ti.i32,
    # output
    sums: f64_3,
):
    """Sum what the matches of a lane give to the equations of a least-squares step."""
    for item, lane in ti.ndrange(sums.shape[0], LANES):
        pair = pairs[item // per_pair]
        start, count = spans[pair, 0], spans[pair, 1]
        limit = wide_product(ti.cast(squares[pair], ti.f64), ti.cast(factor, ti.f64), zero)
        h = f64x9(0.0)
        for i in ti.static(range(9)):
            h[i] = trial[item, i]
        for k in range(SUMS):
            sums[item, k, lane] = 0.0
        for chunk in range((count + (LANES - 1 - lane)) // LANES):
            i = start + chunk * LANES + lane
            x, y = ti.cast(matches[0, i], ti.f64), ti.cast(matches[1, i], ti.f64)
            u, v = ti.cast(matches[2, i], ti.f64), ti.cast(matches[3, i], ti.f64)
            w = (wide_product(h[6], x, zero) + wide_product(h[7], y, zero)) + h[8]
            c = 1.0 / w
            px = (wide_product(h[0], x, zero) + wide_product(h[1], y, zero)) + h[2]
            py = (wide_product(h[3], x, zero) + wide_product(h[4], y, zero)) + h[5]
            p, q = wide_product(px, c, zero), wide_product(py, c, zero)
            ex, ey = p - u, q - v
            if wide_product(ex, ex, zero) + wide_product(ey, ey, zero) < limit:
                a, b = wide_product(x, c, zero), wide_product(y, c, zero)
                square = wide_product(p, p, zero) + wide_product(q, q, zero)
                along = wide_product(p, ex, zero) + wide_product(q, ey, zero)
                row = ti.Vector([a, b, c])
                for m, n in ti.static(((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))):
                    one = wide_product(row[m], row[n], zero)
                    place = ti.static(n if m == 0 else m + n + 1)
                    sums[item, place, lane] += one
                    sums[item, 6 + place, lane] += wide_product(one, p, zero)
                    sums[item, 12 + place, lane] += wide_product(one, q, zero)
                    sums[item, 18 + place, lane] += wide_product(one, square, zero)
                for m in ti.static(range(3)):
                    sums[item, 24 + m, lane] += wide_product(row[m], ex, zero)
                    sums[item, 27 + m, lane] += wide_product(row[m], ey, zero)
                    sums[item, 30 + m, lane] += wide_product(row[m], along, zero)


@ti.func
def _normal(sums: f64_3, item: ti.i32, i: ti.i32, j: ti.i32) -> ti.f64:
    """Return an element of the normal equations of all nine elements; j = 9 is the right side."""
    value = ti.cast(0.0, ti.f64)
    if j == 9:
        value = sums[item, 24 + i, 0]
        if i < 6:
            value = -value
    else:
        low, high = ti.min(i % 3, j % 3), ti.max(i % 3, j % 3)
        place = high if low == 0 else low + high + 1
        side, other = ti.max(i // 3, j // 3), ti.min(i // 3, j // 3)
        if side < 2:
            if side == other:
                value = sums[item, place, 0]
        elif other == 2:
            value = sums[item, 18 + place, 0]
        else:
            value = -sums[item, 6 + 6 * other + place, 0]
    return value


@ti.kernel
def _step(
    kind: ti.template(),
    least: ti.f64,
    zero: ti.i32,
    sums: f64_3,
    equations: f64_3,  # scratch, (items, 10, 10): the last row is the solution
    fixed: i32_1,
    # output
    trial: f64_2,
):
    """Solve for a Gauss-Newton step, and take it."""
    n = ti.static((4, 6, 9)[kind])
    for item in range(sums.shape[0]):
        for level in range(5):
            half = LANES >> (level + 1)
            for k in range(SUMS):
                for lane in range(half):
                    sums[item, k, lane] += sums[item, k, lane + half]
        if ti.static(kind == SIMILARITY):
            _similarity_equations(sums, item, equations, zero)
        else:
            for i in range(n):
                for j in range(n):
                    equations[item, i, j] = _normal(sums, item, i, j)
                equations[item, i, 9] = _normal(sums, item, i, 9)
        trace = ti.cast(0.0, ti.f64)
        for i in range(n):
            trace = trace + equations[item, i, i]
        if ti.static(kind == HOMOGRAPHY):  # the scale of H is free: the step is square to it
            for i in range(9):
                for j in range(9):
                    more = wide_product(
                        wide_product(trace, trial[item, i], zero), trial[item, j], zero
                    )
                    equations[item, i, j] += more
        if fixed[item] and _eliminate(equations, item, n, wide_product(least, trace, zero), zero):
            _move(kind, equations, item, trial)
        else:
            fixed[item] = 0


@ti.func
def _similarity_equations(sums: f64_3, item: ti.i32, equations: f64_3, zero: ti.i32):
    """Reduce the equations to those of (a, b, c, d), h = (a, -b, c, b, a, d, 0, 0, 1)."""
    for i in ti.static(range(4)):
        p, q = ti.static(_AT[i][0], _AT[i][1])
        f, g = ti.static(_TIMES[i][0], _TIMES[i][1])
        for j in ti.static(range(4)):
            r, t = ti.static(_AT[j][0], _AT[j][1])
            m, n = ti.static(_TIMES[j][0], _TIMES[j][1])
            one = f * _normal(sums, item, p, r) * m + f * _normal(sums, item, p, t) * n
            two = g * _normal(sums, item, q, r) * m + g * _normal(sums, item, q, t) * n
            equations[item, i, j] = one + two
        equations[item, i, 9] = f * _normal(sums, item, p, 9) + g * _normal(sums, item, q, 9)


# Where a, b, c and d are in h, and by what they count: products by these are exact.
_AT = ((0, 4), (3, 1), (2, 2), (5, 5))
_TIMES = ((1.0, 1.0), (1.0, -1.0), (0.5, 0.5), (0.5, 0.5))


@ti.func
def _eliminate(a: f64_3, item: ti.i32, n: ti.i32, least: ti.f64, zero: ti.i32) -> ti.i32:
    """Solve n positive definite equations; tell whether they have one solution."""
    solvable = 1
    for k in range(n):
        if not a[item, k, k] > least:
            solvable = 0
        if solvable:
            for i in range(k + 1, n):
                factor = a[item, i, k] / a[item, k, k]
                for j in range(k + 1, n):
                    a[item, i, j] -= wide_product(factor, a[item, k, j], zero)
                a[item, i, 9] -= wide_product(factor, a[item, k, 9], zero)
    if solvable:
        for back in range(n):
            k = n - 1 - back
            total = a[item, k, 9]
            for j in range(k + 1, n):
                total = total - wide_product(a[item, k, j], a[item, 9, j], zero)
            a[item, 9, k] = total / a[item, k, k]
    return solvable


@ti.func
def _move(kind: ti.template(), equations: f64_3, item: ti.i32, trial: f64_2):
    """Add the solution to a model."""
    if ti.static(kind == SIMILARITY):
        trial[item, 0] += equations[item, 9, 0]
        trial[item, 4] = trial[item, 0]
        trial[item, 3] += equations[item, 9, 1]
        trial[item, 1] = -trial[item, 3]
        trial[item, 2] += equations[item, 9, 2]
        trial[item, 5] += equations[item, 9, 3]
    else:
        for i in range(ti.static((4, 6, 9)[kind])):
            trial[item, i] += equations[item, 9, i]
    if ti.static(kind == HOMOGRAPHY):
        largest = ti.cast(0.0, ti.f64)
        for i in range(9):
            largest = ti.max(largest, ti.abs(trial[item, i]))
        for i in range(9):
            trial[item, i] = trial[item, i] / largest


@ti.kernel
def _begin(models: f64_3, fixed: i32_1, trial: f64_2):
    for item in range(trial.shape[0]):
        fixed[item] = 1
        for i in range(9):
            trial[item, i] = models[item // models.shape[1], item % models.shape[1], i]


@ti.kernel
def _factor(schedule: f32_1, step: ti.i32) -> ti.f32:
    return schedule[step]


@primitive
def refine(
    matches: np.ndarray,
    spans: np.ndarray,
    squares: np.ndarray,
    pairs: np.ndarray,
    kind: int,
    schedule: np.ndarray,
    models: np.ndarray,
    costs: np.ndarray,
    supports: np.ndarray,
) -> None:
    """Improve models (A, L, 9) float64 of `pairs` (A,) by steps of least squares over inliers."""
    items, per_pair = costs.shape[0] * costs.shape[1], costs.shape[1]
    trial = scratch((items, 9), np.float64)
    sums = scratch((items, SUMS, LANES), np.float64)
    equations = scratch((items, 10, 10), np.float64)
    fixed = scratch((items,), np.int32)
    given = matches, spans, squares, pairs
    _begin(models, fixed, trial)
    _judge(*given, trial, 0, 0, models, costs, supports)
    for step in range(schedule.shape[0]):
        _add(*given, per_pair, _factor(schedule, step), trial, 0, sums)
        _step(kind, SINGULAR, 0, sums, equations, fixed, trial)
    _judge(*given, trial, 1, 0, models, costs, supports)


@ti.kernel
def _mark(matches: f32_2, spans: i32_2, squares: f32_1, models: f64_2, zero: ti.i32, inliers: u8_1):
    for pair in range(spans.shape[0]):
        h = f32x9(0.0)
        for i in ti.static(range(9)):
            h[i] = ti.cast(models[pair, i], ti.f32)
        for i in range(spans[pair, 0], spans[pair, 0] + spans[pair, 1]):
            inliers[i] = ti.cast(_transfer(h, matches, i, zero) < squares[pair], ti.u8)


@primitive
def mark(
    matches: np.ndarray,
    spans: np.ndarray,
    squares: np.ndarray,
    kind: int,
    models: np.ndarray,
    inliers: np.ndarray,
) -> None:
    """Tell which matches are closer to the model (P, 9) of their pair than the threshold."""
    _mark(matches, spans, squares, models, 0, inliers)
