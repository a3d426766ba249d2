"""Robust fits: hypotheses from samples of matches, scored, refined, chosen; the same for any model.

A fit depends on the set of its matches alone: not on their order, the other pairs of a batch, the
device or the kernel set.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cvkern._runtime import Runtime
from cvkern.kernels.codes.geometry import (
    COST_ONE,
    GROUP,
    LANES,
    MAX_MATCHES,
    NO_COST,
    SAMPLE,
    Model,
)

FIRST, MOST = 512, 8192  # hypotheses of the first round, and of any
LEAST = 1024  # hypotheses in all
CANDIDATES = 2  # models of a round that are refined
_INDEX = np.uint64(MAX_MATCHES - 1)
# Squares of the thresholds of the steps of least squares, over the square of the caller's.
COARSE = np.array([9.0, 4.0, 2.0, 2.0], np.float32)
FINE = np.array([2.0] * 4, np.float32)
# Samples without outliers that are wanted: noise spoils some of them.
SPARE = 2.0
# The search ends when a model of so many times the inliers would have been found.
LARGER = 1.5


class RobustFit(NamedTuple):
    """A model that many matches agree on."""

    matrix: np.ndarray | None
    """(3, 3) float64, acts on (x, y, 1) with x the column and y the row; None where there is no
    such model."""
    inliers: Any
    """(N,) bool, of the caller's library: the matches within the threshold."""
    cost: float
    """Sum over the matches, equal ones once, of the squared residual in thresholds, at most 1."""


class RobustFits(NamedTuple):
    """The models of several pairs of images."""

    matrices: np.ndarray
    """(B, 3, 3) float64, as of a `RobustFit`; NaN where a pair has no model."""
    inliers: Any
    """bool, one after the other for all pairs, of the caller's library."""
    offsets: np.ndarray
    """(B + 1,) int64: the matches of pair b are `inliers[offsets[b]:offsets[b + 1]]`."""
    costs: np.ndarray
    """(B,) float64, as of a `RobustFit`."""


class Search(NamedTuple):
    """The options of a robust fit."""

    threshold: float
    confidence: float
    max_trials: int
    seed: int


class Batch(NamedTuple):
    """The matches of several pairs, as kernels take them."""

    matches: np.ndarray
    """x0, y0, x1, y1, within [-1, 1], (4, M) float32; a pair begins at a multiple of `LANES`."""
    spans: np.ndarray
    """First and number of the matches of each pair, (P, 2) int32."""
    places: np.ndarray
    """Where each match is in `matches`, (N,) int64; -1 for those that are not finite."""
    to_unit: np.ndarray
    """The matrices that scale the points of either image, (2, P, 3, 3) float64."""
    sides: np.ndarray
    """Width and height of the box of the scaled points of the second image, (P, 2) float64."""


def gather(pairs: Sequence[tuple[np.ndarray, np.ndarray]], *, alike: bool = False) -> Batch:
    """Scale the matches of each pair, in the order of a hash of their coordinates, equal ones once.

    Points are (row, column). Any order of the same matches gives the same batch, and its first
    matches are as good as drawn by lot. The centre and the scale (a power of two, of both images
    if `alike`) are those of the points' box, which no order rounds otherwise.
    """
    lists = [_sorted(_columns(a, b)) for a, b in pairs]
    counts = np.array([values.shape[1] for values, _ in lists], np.int64)
    rooms = -(-counts // LANES) * LANES
    starts = np.cumsum(rooms) - rooms
    matches = np.zeros((4, max(int(rooms.sum()), LANES)), np.float32)
    to_unit = np.zeros((2, len(pairs), 3, 3))
    to_unit[:, :, 2, 2] = 1
    sides = np.zeros((len(pairs), 2))
    places = []
    for i, (values, place) in enumerate(lists):
        places.append(np.where(place >= 0, place + starts[i], -1))
        if not counts[i]:
            to_unit[:, i] = np.eye(3)
            continue
        low, high = values.min(axis=1), values.max(axis=1)
        half = ((high - low) / 2).reshape(2, 2).max(axis=1)
        half[:] = half.max() if alike else half
        scale = np.ldexp(1.0, -np.frexp(np.where(half > 0, half, 1.0))[1]).repeat(2)
        shift = scale * (low + high) / 2
        matches[:, starts[i] : starts[i] + counts[i]] = values * scale[:, None] - shift[:, None]
        to_unit[:, i, (0, 1), (0, 1)] = scale.reshape(2, 2)
        to_unit[:, i, :2, 2] = -shift.reshape(2, 2)
        sides[i] = ((high - low) * scale)[2:]
    spans = np.stack((starts, counts), 1).astype(np.int32)
    return Batch(matches, spans, np.concatenate(places), to_unit, sides)


def _columns(points0: np.ndarray, points1: np.ndarray) -> np.ndarray:
    """Return x0, y0, x1, y1, (4, N) float64."""
    values = np.empty((4, len(points0)))
    values[0], values[1] = points0[:, 1], points0[:, 0]
    values[2], values[3] = points1[:, 1], points1[:, 0]
    values += 0.0  # one zero, not two
    return values


def _sorted(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return finite matches (4, K) by their hash, and where each of (4, N) is among them, or -1.

    Two different matches of one hash, of 46 bits, are in the order in which they came.
    """
    count = values.shape[1]
    kept = np.arange(count)
    if not np.isfinite(values).all():
        kept = np.flatnonzero(np.isfinite(values).all(axis=0))
        values = values[:, kept]
    keys = np.zeros(len(kept), np.uint64)
    for row in values.view(np.uint64):  # mixed as by splitmix64
        keys ^= row
        keys *= np.uint64(0x9E3779B97F4A7C15)
        keys ^= keys >> np.uint64(29)
    keys &= ~_INDEX
    keys |= np.arange(len(kept), dtype=np.uint64)
    keys.sort()
    order = (keys & _INDEX).astype(np.int64)
    values = values.take(order, axis=1)
    place = np.full(count, -1, np.int64)
    keys >>= np.uint64(18)
    same = keys[1:] == keys[:-1]
    if not same.any():
        place[kept[order]] = np.arange(len(order))
        return values, place
    fresh = np.ones(len(order), bool)
    fresh[1:] = ~same | (values[:, 1:] != values[:, :-1]).any(axis=0)
    place[kept[order]] = np.cumsum(fresh) - 1
    return values[:, fresh], place


def search(
    rt: Runtime, batch: Batch, model: Model, options: Search
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return matrices (P, 3, 3), or NaN, inliers (M,) uint8 and costs (P,) float64."""
    count = batch.spans[:, 1]
    squares = ((options.threshold * batch.to_unit[1, :, 0, 0]) ** 2).astype(np.float32)
    matches, spans, square = (
        rt.send(f"robust.{name}", values)
        for name, values in (
            ("matches", batch.matches), ("spans", batch.spans), ("squares", squares),
        )
    )  # fmt: skip
    given = matches, spans, square
    kernels = rt.geometry.robust
    best = np.zeros((len(count), 9))
    costs = np.full(len(count), NO_COST, np.int64)
    rough = costs.copy()  # of hypotheses as they were found
    supports = np.zeros(len(count), np.int64)
    trials = np.zeros(len(count), np.int64)

    def refined(chosen: Any, pairs: Any, schedule: np.ndarray) -> list[np.ndarray]:
        shape = chosen.shape[:2]
        cost = rt.scratch("robust.refined", shape, np.int32)
        support = rt.scratch("robust.supports", shape, np.int32)
        kernels.refine(*given, pairs, int(model), rt.constant(schedule), chosen, cost, support)
        return [rt.to_numpy(a) for a in (chosen, cost, support)]

    active = np.flatnonzero(count >= SAMPLE[model]).astype(np.int32)
    done, size = 0, FIRST
    while len(active) and done < options.max_trials:
        size = min(size, -(-(options.max_trials - done) // GROUP) * GROUP)
        pairs = rt.send("robust.pairs", active)
        found = rt.scratch("robust.models", (len(active), size // GROUP, 9))
        found_costs = rt.scratch("robust.costs", found.shape[:2], np.int32)
        kernels.propose(*given, pairs, int(model), options.seed, done, found, found_costs)
        least = rt.to_numpy(found_costs).min(axis=1)
        promising = least < rough[active]
        rough[active] = np.minimum(rough[active], least)
        if promising.any():
            to = active[promising]
            chosen = rt.scratch("robust.chosen", (len(to), CANDIDATES, 9), np.float64)
            rows = rt.send("robust.rows", np.flatnonzero(promising).astype(np.int32))
            kernels.choose(found, found_costs, rows, chosen)
            models, cost, support = refined(chosen, rt.send("robust.pairs", to), COARSE)
            rank = np.argmin(cost, axis=1)  # the first of equals
            row = np.arange(len(to))
            better = cost[row, rank] < costs[to]
            to, row, rank = to[better], row[better], rank[better]
            best[to] = models[row, rank]
            costs[to], supports[to] = cost[row, rank], support[row, rank]
        done += size
        trials[active] = done
        wanted = _wanted(supports[active] / count[active], SAMPLE[model], options.confidence)
        active = active[done < wanted]
        size = min(done, MOST)

    everyone = np.arange(len(count), dtype=np.int32)
    chosen = rt.scratch("robust.chosen", (len(count), 1, 9), np.float64)
    rt.write(chosen, best[:, None])
    models, cost, support = refined(chosen, rt.send("robust.pairs", everyone), FINE)
    inliers = rt.scratch("robust.inliers", (batch.matches.shape[1],), np.uint8)
    last = rt.send("robust.last", np.ascontiguousarray(models[:, 0]))
    kernels.mark(*given, int(model), last, inliers)
    marks = np.array(rt.to_numpy(inliers))
    matrices = models.reshape(-1, 3, 3).copy()
    none = ~_significant(support[:, 0], count, trials, _chance(batch, squares), SAMPLE[model])
    matrices[none] = np.nan
    for begin, number in batch.spans[none]:
        marks[begin : begin + number] = 0
    final = np.where(none, count, cost[:, 0] / COST_ONE)
    return matrices, marks, final


def _wanted(share: np.ndarray, size: int, confidence: float) -> np.ndarray:
    """Return how many samples show, with `confidence`, that no model has many more inliers."""
    good = np.clip((LARGER * share) ** size, 1e-12, 1 - 1e-12)
    return np.maximum(SPARE * math.log(1 - confidence) / np.log1p(-good), LEAST)


def _chance(batch: Batch, squares: np.ndarray) -> np.ndarray:
    """Return the share of the second image's box that is within the threshold of a point."""
    square = squares.astype(np.float64)
    area = np.prod(batch.sides + 2 * np.sqrt(square)[:, None], axis=1)
    return np.minimum(math.pi * square / area, 1.0)


def _significant(
    support: np.ndarray, count: np.ndarray, trials: np.ndarray, chance: np.ndarray, size: int
) -> np.ndarray:
    """Tell where so many inliers are no accident.

    Under outliers alone less than one fit like this is expected among all subsets of the matches
    and all trials [L. Moisan and B. Stival, IJCV 57(3), 2004]; or all matches are inliers.
    """
    log = np.frompyfunc(math.lgamma, 1, 1)
    n, k = count.astype(np.float64), support.astype(np.float64)
    subsets = (log(n + 1) - log(k + 1) - log(n - k + 1)).astype(np.float64)
    with np.errstate(divide="ignore"):
        accidents = subsets + np.log(np.maximum(trials, 1)) + (k - size) * np.log(chance)
    return (support >= size) & ((accidents < 0) | (support == count))
