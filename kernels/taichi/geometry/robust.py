"""Robust fits to matches in Taichi.

A hypothesis is a model through the fewest matches that fix it: maps (_maps.py), fundamental
(_epipolar.py) and essential matrices (_essential.py), or poses (_pose.py). A counter draws these
matches from (seed, hypothesis, draw), so any hypothesis can be computed again alone. The cost of a
model is ``sum min(r_i^2 / t^2, 1)`` with the residuals r and the threshold t [P. Torr and A.
Zisserman, "MLESAC", CVIU 78(1), 2000], each term an integer of 2^-12, so that no order of adding
shows. The hypothesis of a group that costs least on its first matches is scored on all matches, and
the best ones are refined by Gauss-Newton steps over the matches near them (_refinement.py)
[O. Chum, J. Matas and J. Kittler, "Locally optimized RANSAC", DAGM 2003].

One thread takes a group of hypotheses, a lane of a sum, or a model. The order of arithmetic is that
of kernels/warp/geometry/_robust.h. `zero` is always 0.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.geometry import (
    DRAWS,
    FLAT,
    GROUP,
    LANES,
    NO_COST,
    PREVIEW,
    SAMPLE,
    SUMS,
    Draw,
    Given,
    Model,
)
from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi._random import random_index
from cvkern.kernels.taichi._rounding import wide_product

from . import _epipolar as epipolar
from . import _essential as essential
from . import _maps as maps
from . import _pose as pose
from . import _refinement as refinement
from ._scores import cost_of, prepared, residual

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
f64_2 = ti.types.ndarray(dtype=ti.f64, ndim=2)
f64_3 = ti.types.ndarray(dtype=ti.f64, ndim=3)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
i32_3 = ti.types.ndarray(dtype=ti.i32, ndim=3)
u8_1 = ti.types.ndarray(dtype=ti.u8, ndim=1)

f32x9 = ti.types.vector(9, ti.f32)
f64x8 = ti.types.vector(8, ti.f64)
f64x9 = ti.types.vector(9, ti.f64)

i32x3 = ti.types.vector(3, ti.i32)

SIMILARITY, AFFINE, HOMOGRAPHY, FUNDAMENTAL, PARALLAX, ESSENTIAL, POSE = (int(m) for m in Model)
SEVERAL = (FUNDAMENTAL, ESSENTIAL, POSE)  # a sample of these leaves several models


@ti.func
def _solve(
    kind: ti.template(),
    matches: f32_2,
    span: ti.template(),
    known: f64_2,
    pair: ti.i32,
    seed: ti.i32,
    hypothesis: ti.i32,
    thread: ti.i32,
    zero: ti.i32,
    work: f64_3,
    notes: i32_3,
):
    """Return how many models the sample of a hypothesis fixes, and the one where it is one."""
    size = ti.static(SAMPLE[kind])
    picked = ti.Vector([-1] * 8)
    found = True
    x, y, u, v, z = f64x8(0.0), f64x8(0.0), f64x8(0.0), f64x8(0.0), f64x8(0.0)
    for s in range(size):
        fresh = False
        for n in range(DRAWS):
            if not fresh:
                picked[s] = random_index(seed, 0, hypothesis, s + 8 * n, span[1])
                fresh = True
                for r in range(s):
                    fresh = fresh and picked[r] != picked[s]
        found = found and fresh
        i = span[0] + picked[s]
        x[s], y[s] = ti.cast(matches[0, i], ti.f64), ti.cast(matches[1, i], ti.f64)
        u[s], v[s] = ti.cast(matches[2, i], ti.f64), ti.cast(matches[3, i], ti.f64)
        if ti.static(kind == POSE):
            z[s] = ti.cast(matches[4, i], ti.f64)
    solved = False
    number = 0
    h = f64x9(0.0)
    flat = ti.f64(FLAT)
    if ti.static(kind == FUNDAMENTAL):
        for s in range(7):
            row = ti.Vector([u[s], v[s]])
            for k in ti.static(range(2)):
                work[thread, s, 3 * k] = wide_product(row[k], x[s], zero)
                work[thread, s, 3 * k + 1] = wide_product(row[k], y[s], zero)
                work[thread, s, 3 * k + 2] = row[k]
            work[thread, s, 6], work[thread, s, 7], work[thread, s, 8] = x[s], y[s], 1.0
        if found:
            number = epipolar.seven(work, notes, thread, zero)
    elif ti.static(kind == ESSENTIAL):
        if found:
            number = essential.five(x, y, u, v, known, pair, work, notes, thread, zero)
    elif ti.static(kind == POSE):
        if found:
            inverse = essential.camera(known, pair, 1)
            number = pose.three(x, y, z, u, v, inverse, flat, work, notes, thread, zero)
    elif ti.static(kind == PARALLAX):
        solved, h = epipolar.parallax(x, y, u, v, essential.camera(known, pair, 0), zero)
    elif ti.static(kind == SIMILARITY):
        solved, h = maps.similarity(x, y, u, v, flat, zero)
    elif ti.static(kind == AFFINE):
        solved, h = maps.affine(x, y, u, v, flat, zero)
    else:
        solved, h = maps.homography(x, y, u, v, flat, zero)
    if found and solved:
        number = 1
    return number, h


@ti.kernel
def _propose(
    matches: f32_2,
    spans: i32_2,
    squares: f32_1,
    known: f64_2,
    pairs: i32_1,
    kind: ti.template(),
    draw: i32x3,  # the seed, the first hypothesis, and 0
    # scratch
    work: f64_3,
    notes: i32_3,
    # outputs
    models: f32_3,
    costs: i32_2,
):
    for a, g in ti.ndrange(costs.shape[0], costs.shape[1]):
        pair, thread, zero = pairs[a], a * costs.shape[1] + g, draw[2]
        start, count, square = spans[pair, 0], spans[pair, 1], squares[pair]
        span = ti.Vector([start, count])
        best = f32x9(0.0)
        least = NO_COST
        for n in range(GROUP):
            hypothesis = draw[1] + g * GROUP + n
            number, model = _solve(
                kind, matches, span, known, pair, draw[0], hypothesis, thread, zero, work, notes
            )
            for m in range(number):
                h = ti.cast(model, ti.f32)
                if ti.static(kind in SEVERAL):
                    for i in ti.static(range(9)):
                        h[i] = ti.cast(work[thread, epipolar.MODELS + m, i], ti.f32)
                f = prepared(kind, h, known, pair, zero)
                cost, _ = cost_of(kind, f, matches, start, ti.min(count, PREVIEW), square, zero)
                if cost < least:
                    least = cost
                    best = h
        if least < NO_COST:
            f = prepared(kind, best, known, pair, zero)
            least, _ = cost_of(kind, f, matches, start, count, square, zero)
        costs[a, g] = least
        for i in ti.static(range(9)):
            models[a, g, i] = best[i]


@primitive
def propose(
    given: Given, pairs: np.ndarray, draw: Draw, models: np.ndarray, costs: np.ndarray
) -> None:
    """Score the best hypothesis of each group on all matches of a pair."""
    threads = costs.shape[0] * costs.shape[1] if draw.kind in SEVERAL else 1
    page = essential.PAGE if draw.kind == ESSENTIAL else epipolar.PAGE
    work = scratch((threads, *page), np.float64)
    notes = scratch((threads, *epipolar.NOTES), np.int32)
    drawn = ti.Vector([draw.seed, draw.first, 0])
    _propose(*given, pairs, draw.kind, drawn, work, notes, models, costs)


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


@primitive
def refine(
    given: Given,
    pairs: np.ndarray,
    kind: int,
    schedule: np.ndarray,
    models: np.ndarray,
    scores: np.ndarray,
) -> None:
    """Improve models (A, L, 9) float64 of `pairs` (A,) by steps of least squares over inliers."""
    items, per_pair = scores.shape[0] * scores.shape[1], scores.shape[1]
    trial = scratch((items, 9), np.float64)
    sums = scratch((items, SUMS[kind], LANES), np.float64)
    rows = essential.ROWS if kind == ESSENTIAL else 10
    equations = scratch((items, rows, 10), np.float64)
    fixed = scratch((items,), np.int32)
    given_and_pairs = *given, pairs
    refinement.begin(models, fixed, trial)
    refinement.judge(*given_and_pairs, kind, trial, 0, 0, models, scores)
    for step in range(schedule.shape[0]):
        limit = refinement.factor(schedule, step)
        refinement.add(*given_and_pairs, kind, per_pair, limit, trial, 0, sums)
        refinement.step(
            given.known, pairs, kind, per_pair, refinement.SINGULAR, 0, sums, equations, fixed,
            trial,
        )  # fmt: skip
    refinement.judge(*given_and_pairs, kind, trial, 1, 0, models, scores)


@ti.kernel
def _mark(
    matches: f32_2,
    spans: i32_2,
    squares: f32_1,
    known: f64_2,
    kind: ti.template(),
    models: f64_2,
    zero: ti.i32,
    inliers: u8_1,
):
    for pair in range(spans.shape[0]):
        model = f32x9(0.0)
        for i in ti.static(range(9)):
            model[i] = ti.cast(models[pair, i], ti.f32)
        h = prepared(kind, model, known, pair, zero)
        for i in range(spans[pair, 0], spans[pair, 0] + spans[pair, 1]):
            inliers[i] = ti.cast(residual(kind, h, matches, i, zero) < squares[pair], ti.u8)


@primitive
def mark(given: Given, kind: int, models: np.ndarray, inliers: np.ndarray) -> None:
    """Tell which matches are closer to the model (P, 9) of their pair than the threshold."""
    _mark(*given, kind, models, 0, inliers)
