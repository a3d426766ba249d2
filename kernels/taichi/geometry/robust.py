"""Robust fits to matches in Taichi: one thread a group of hypotheses, a lane of a sum, or a model.

The order of arithmetic is that of kernels/warp/geometry/_robust.h. `zero` is always 0.
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
    Model,
)
from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi._random import random_index
from cvkern.kernels.taichi._rounding import wide_product

from . import _epipolar as epipolar
from . import _maps as maps
from . import _refinement as refinement
from ._scores import cost_of, residual

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

SIMILARITY, AFFINE, HOMOGRAPHY, FUNDAMENTAL, PARALLAX = (int(m) for m in Model)


@ti.func
def _solve(
    kind: ti.template(),
    matches: f32_2,
    start: ti.i32,
    count: ti.i32,
    seed: ti.i32,
    hypothesis: ti.i32,
    flat: ti.f64,
    plane: f64x9,
    thread: ti.i32,
    zero: ti.i32,
    work: f64_3,
    notes: i32_3,
):
    """Return how many models the sample of a hypothesis fixes, and the one where it is one."""
    size = ti.static(SAMPLE[kind])
    picked = ti.Vector([-1] * 8)
    found = True
    x, y, u, v = f64x8(0.0), f64x8(0.0), f64x8(0.0), f64x8(0.0)
    for s in range(size):
        fresh = False
        for n in range(DRAWS):
            if not fresh:
                picked[s] = random_index(seed, 0, hypothesis, s + 8 * n, count)
                fresh = True
                for r in range(s):
                    fresh = fresh and picked[r] != picked[s]
        found = found and fresh
        i = start + picked[s]
        x[s], y[s] = ti.cast(matches[0, i], ti.f64), ti.cast(matches[1, i], ti.f64)
        u[s], v[s] = ti.cast(matches[2, i], ti.f64), ti.cast(matches[3, i], ti.f64)
    solved = False
    number = 0
    h = f64x9(0.0)
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
    elif ti.static(kind == PARALLAX):
        solved, h = epipolar.parallax(x, y, u, v, plane, zero)
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
    planes: f64_2,
    pairs: i32_1,
    kind: ti.template(),
    seed: ti.i32,
    first: ti.i32,
    flat: ti.f64,
    zero: ti.i32,
    # scratch
    work: f64_3,
    notes: i32_3,
    # outputs
    models: f32_3,
    costs: i32_2,
):
    for a, g in ti.ndrange(costs.shape[0], costs.shape[1]):
        pair, thread = pairs[a], a * costs.shape[1] + g
        start, count, square = spans[pair, 0], spans[pair, 1], squares[pair]
        plane = f64x9(0.0)
        if ti.static(kind == PARALLAX):
            for i in ti.static(range(9)):
                plane[i] = planes[pair, i]
        best = f32x9(0.0)
        least = NO_COST
        for n in range(GROUP):
            hypothesis = first + g * GROUP + n
            number, model = _solve(
                kind, matches, start, count, seed, hypothesis, flat, plane, thread, zero, work,
                notes,
            )  # fmt: skip
            for m in range(number):
                h = ti.cast(model, ti.f32)
                if ti.static(kind == FUNDAMENTAL):
                    for i in ti.static(range(9)):
                        h[i] = ti.cast(work[thread, epipolar.MODELS + m, i], ti.f32)
                cost, _ = cost_of(kind, h, matches, start, ti.min(count, PREVIEW), square, zero)
                if cost < least:
                    least = cost
                    best = h
        if least < NO_COST:
            least, _ = cost_of(kind, best, matches, start, count, square, zero)
        costs[a, g] = least
        for i in ti.static(range(9)):
            models[a, g, i] = best[i]


@primitive
def propose(
    matches: np.ndarray,
    spans: np.ndarray,
    squares: np.ndarray,
    planes: np.ndarray,
    pairs: np.ndarray,
    kind: int,
    seed: int,
    first: int,
    models: np.ndarray,
    costs: np.ndarray,
) -> None:
    """Score the best hypothesis of each group on all matches of a pair."""
    threads = costs.shape[0] * costs.shape[1] if kind == FUNDAMENTAL else 1
    work = scratch((threads, *epipolar.PAGE), np.float64)
    notes = scratch((threads, *epipolar.NOTES), np.int32)
    given = matches, spans, squares, planes, pairs
    _propose(*given, kind, seed, first, FLAT, 0, work, notes, models, costs)


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
    sums = scratch((items, SUMS[kind], LANES), np.float64)
    equations = scratch((items, 10, 10), np.float64)
    fixed = scratch((items,), np.int32)
    given = matches, spans, squares, pairs
    refinement.begin(models, fixed, trial)
    refinement.judge(*given, kind, trial, 0, 0, models, costs, supports)
    for step in range(schedule.shape[0]):
        refinement.add(*given, kind, per_pair, refinement.factor(schedule, step), trial, 0, sums)
        refinement.step(kind, refinement.SINGULAR, 0, sums, equations, fixed, trial)
    refinement.judge(*given, kind, trial, 1, 0, models, costs, supports)


@ti.kernel
def _mark(
    matches: f32_2,
    spans: i32_2,
    squares: f32_1,
    kind: ti.template(),
    models: f64_2,
    zero: ti.i32,
    inliers: u8_1,
):
    for pair in range(spans.shape[0]):
        h = f32x9(0.0)
        for i in ti.static(range(9)):
            h[i] = ti.cast(models[pair, i], ti.f32)
        for i in range(spans[pair, 0], spans[pair, 0] + spans[pair, 1]):
            inliers[i] = ti.cast(residual(kind, h, matches, i, zero) < squares[pair], ti.u8)


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
    _mark(matches, spans, squares, kind, models, 0, inliers)
