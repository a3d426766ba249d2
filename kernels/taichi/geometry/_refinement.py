"""Gauss-Newton steps of models over the matches near them, in Taichi; robust.py has the method.

The normal equations are sums over lanes of matches, added in a fixed order. One thread takes a lane
of a sum, or a model. The order of arithmetic is that of kernels/warp/geometry/_robust.h. `zero` is
always 0.
"""

import taichi as ti

from cvkern.kernels.codes.geometry import LANES, Model
from cvkern.kernels.taichi._rounding import wide_product

from . import _epipolar as epipolar
from . import _essential as essential
from . import _pose as pose
from ._scores import cost_of, prepared

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f64_2 = ti.types.ndarray(dtype=ti.f64, ndim=2)
f64_3 = ti.types.ndarray(dtype=ti.f64, ndim=3)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
i32_3 = ti.types.ndarray(dtype=ti.i32, ndim=3)

f32x9 = ti.types.vector(9, ti.f32)
f64x9 = ti.types.vector(9, ti.f64)
f64x12 = ti.types.vector(12, ti.f64)

SIMILARITY, AFFINE, HOMOGRAPHY, FUNDAMENTAL, _, ESSENTIAL, POSE = (int(m) for m in Model)
UNKNOWNS = (4, 6, 9, 9, 9, 6, 6)  # unknowns of a step, by model
SINGULAR = 1e-13  # pivots below this share of the trace fix no model


@ti.kernel
def judge(
    matches: f32_2,
    spans: i32_2,
    squares: f32_1,
    known: f64_2,
    pairs: i32_1,
    kind: ti.template(),
    trial: f64_2,
    again: ti.i32,
    zero: ti.i32,
    # outputs
    models: f64_3,
    scores: i32_3,
):
    """Keep the trial of each model unless it costs more than before by over a sixteenth."""
    for a, rank in ti.ndrange(scores.shape[0], scores.shape[1]):
        pair = pairs[a]
        item = a * scores.shape[1] + rank
        model = f32x9(0.0)
        for i in ti.static(range(9)):
            model[i] = ti.cast(trial[item, i], ti.f32)
        h = prepared(kind, model, known, pair, zero)
        start, count = spans[pair, 0], spans[pair, 1]
        cost, support = cost_of(kind, h, matches, start, count, squares[pair], zero)
        before = scores[a, rank, 0]
        if not again or cost <= before + (before >> 4):
            scores[a, rank, 0] = cost
            scores[a, rank, 1] = support
            for i in range(9):
                models[a, rank, i] = trial[item, i]


@ti.kernel
def add(
    matches: f32_2,
    spans: i32_2,
    squares: f32_1,
    known: f64_2,
    pairs: i32_1,
    kind: ti.template(),
    per_pair: ti.i32,
    factor: ti.f32,
    trial: f64_2,
    zero: ti.i32,
    # output
    sums: f64_3,
):
    """Sum the terms of the matches of a lane in the equations of a least-squares step."""
    for item, lane in ti.ndrange(sums.shape[0], LANES):
        pair = pairs[item // per_pair]
        start, count = spans[pair, 0], spans[pair, 1]
        limit = wide_product(ti.cast(squares[pair], ti.f64), ti.cast(factor, ti.f64), zero)
        h = f64x9(0.0)
        for i in ti.static(range(9)):
            h[i] = trial[item, i]
        for k in range(sums.shape[1]):
            sums[item, k, lane] = 0.0
        for chunk in range((count + (LANES - 1 - lane)) // LANES):
            i = start + chunk * LANES + lane
            x, y = ti.cast(matches[0, i], ti.f64), ti.cast(matches[1, i], ti.f64)
            u, v = ti.cast(matches[2, i], ti.f64), ti.cast(matches[3, i], ti.f64)
            if ti.static(kind == POSE):
                k = essential.camera(known, pair, 0)
                point = ti.Vector([x, y, ti.cast(matches[4, i], ti.f64)])
                counts, slopes, e, weight = pose.derive(h, k, point, u, v, limit, zero)
                if counts:
                    _add_pose(slopes, e, weight, item, lane, zero, sums)
            elif ti.static(kind >= FUNDAMENTAL):
                counts, t, n, w = epipolar.derive(h, x, y, u, v, limit, zero)
                if counts:
                    k = 0
                    for i in ti.static(range(9)):
                        weighed = wide_product(t[i], w, zero)
                        for j in ti.static(range(i, 9)):
                            sums[item, k, lane] = sums[item, k, lane] + wide_product(
                                weighed, t[j], zero
                            )
                            k += 1
                        sums[item, 45 + i, lane] = sums[item, 45 + i, lane] + wide_product(
                            weighed, n, zero
                        )
            else:
                _add_map(h, x, y, u, v, limit, item, lane, zero, sums)


@ti.func
def _add_pose(
    t: f64x12,
    e: ti.template(),
    weight: ti.f64,
    item: ti.i32,
    lane: ti.i32,
    zero: ti.i32,
    sums: f64_3,
):
    k = 0
    for i in ti.static(range(6)):
        one, two = wide_product(t[i], weight, zero), wide_product(t[6 + i], weight, zero)
        for j in ti.static(range(i, 6)):
            both = wide_product(one, t[j], zero) + wide_product(two, t[6 + j], zero)
            sums[item, k, lane] = sums[item, k, lane] + both
            k += 1
        both = wide_product(one, e[0], zero) + wide_product(two, e[1], zero)
        sums[item, 21 + i, lane] = sums[item, 21 + i, lane] + both


@ti.func
def _add_map(
    h: f64x9,
    x: ti.f64,
    y: ti.f64,
    u: ti.f64,
    v: ti.f64,
    limit: ti.f64,
    item: ti.i32,
    lane: ti.i32,
    zero: ti.i32,
    sums: f64_3,
):
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
            sums[item, place, lane] = sums[item, place, lane] + one
            sums[item, 6 + place, lane] = sums[item, 6 + place, lane] + wide_product(one, p, zero)
            sums[item, 12 + place, lane] = sums[item, 12 + place, lane] + wide_product(one, q, zero)
            sums[item, 18 + place, lane] = sums[item, 18 + place, lane] + wide_product(
                one, square, zero
            )
        for m in ti.static(range(3)):
            sums[item, 24 + m, lane] = sums[item, 24 + m, lane] + wide_product(row[m], ex, zero)
            sums[item, 27 + m, lane] = sums[item, 27 + m, lane] + wide_product(row[m], ey, zero)
            sums[item, 30 + m, lane] = sums[item, 30 + m, lane] + wide_product(row[m], along, zero)


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
def step(
    known: f64_2,
    pairs: i32_1,
    kind: ti.template(),
    per_pair: ti.i32,
    least: ti.f64,
    zero: ti.i32,
    sums: f64_3,
    equations: f64_3,  # scratch, (items, 10 or more, 10): row 9 is the solution
    fixed: i32_1,
    # output
    trial: f64_2,
):
    """Solve for a Gauss-Newton step, and take it."""
    n = ti.static(UNKNOWNS[kind])
    for item in range(sums.shape[0]):
        for level in range(5):
            half = LANES >> (level + 1)
            for k in range(sums.shape[1]):
                for lane in range(half):
                    sums[item, k, lane] = sums[item, k, lane] + sums[item, k, lane + half]
        if ti.static(kind == SIMILARITY):
            _similarity_equations(sums, item, equations, zero)
        elif ti.static(kind < FUNDAMENTAL):
            for i in range(n):
                for j in range(n):
                    equations[item, i, j] = _normal(sums, item, i, j)
                equations[item, i, 9] = _normal(sums, item, i, 9)
        trace = ti.cast(0.0, ti.f64)
        if ti.static(kind < FUNDAMENTAL):
            for i in range(n):
                trace = trace + equations[item, i, i]
        if ti.static(kind == HOMOGRAPHY):  # the scale of H is free: the step is square to it
            for i in range(9):
                for j in range(9):
                    more = wide_product(
                        wide_product(trace, trial[item, i], zero), trial[item, j], zero
                    )
                    equations[item, i, j] = equations[item, i, j] + more
        solvable = fixed[item]
        if ti.static(kind == FUNDAMENTAL):
            possible, whole = epipolar.equations(sums, trial, item, equations, zero)
            trace = whole
            if not possible:
                solvable = 0
        pair = pairs[item // per_pair]
        if ti.static(kind == ESSENTIAL):
            trace = essential.equations(sums, known, pair, trial, item, equations, zero)
        if ti.static(kind == POSE):
            trace = pose.equations(sums, item, equations)
        if solvable:
            solvable = _eliminate(equations, item, n, wide_product(least, trace, zero), zero)
        if solvable:
            if ti.static(kind == ESSENTIAL):
                solvable = essential.move(equations, item, trial, zero)
            elif ti.static(kind == POSE):
                solvable = pose.move(equations, item, trial, zero)
            else:
                _move(kind, equations, item, trial)
        fixed[item] = solvable


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


# Indices of a, b, c and d in h, and their factors; products by these factors are exact.
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
                    a[item, i, j] = a[item, i, j] - wide_product(factor, a[item, k, j], zero)
                a[item, i, 9] = a[item, i, 9] - wide_product(factor, a[item, k, 9], zero)
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
        trial[item, 0] = trial[item, 0] + equations[item, 9, 0]
        trial[item, 4] = trial[item, 0]
        trial[item, 3] = trial[item, 3] + equations[item, 9, 1]
        trial[item, 1] = -trial[item, 3]
        trial[item, 2] = trial[item, 2] + equations[item, 9, 2]
        trial[item, 5] = trial[item, 5] + equations[item, 9, 3]
    else:
        for i in range(ti.static((4, 6, 9, 9)[kind])):
            trial[item, i] = trial[item, i] + equations[item, 9, i]
    if ti.static(kind >= HOMOGRAPHY):
        largest = ti.cast(0.0, ti.f64)
        for i in range(9):
            largest = ti.max(largest, ti.abs(trial[item, i]))
        inverse = 1.0 / largest
        for i in range(9):
            trial[item, i] = trial[item, i] * inverse


@ti.kernel
def begin(models: f64_3, fixed: i32_1, trial: f64_2):
    for item in range(trial.shape[0]):
        fixed[item] = 1
        for i in range(9):
            trial[item, i] = models[item // models.shape[1], item % models.shape[1], i]


@ti.kernel
def factor(schedule: f32_1, step: ti.i32) -> ti.f32:
    return schedule[step]
