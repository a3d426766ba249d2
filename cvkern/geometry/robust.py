"""Robust fits of any model: draw samples, score hypotheses, refine the best, and select one.

A fit depends only on the set of its matches. It does not depend on their order, the other pairs of
a batch, the device or the kernel set.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._runtime import Runtime
from cvkern.geometry._matches import Batch
from cvkern.kernels.codes.geometry import (
    COST_ONE,
    GROUP,
    NO_COST,
    SAMPLE,
    Draw,
    Given,
    Model,
)

FIRST, MOST = 512, 8192  # hypotheses of the first round, and largest number in a round
CANDIDATES = 2  # models of a round that are refined
MOST_SQUARE = 1e36  # squared threshold in the unit of kernels, far from the end of float32
# Squared thresholds of the least-squares steps, over the square of the caller's threshold. The
# first ones are wide, because the model of a noisy sample is far from many of its inliers.
COARSE = np.array([25.0, 9.0, 4.0, 2.0], np.float32)
FINE = np.array([4.0] * 4, np.float32)  # maps: wide, as planes of photographs bend a little
LAST = np.array([3.0] * 6, np.float32)  # other models, whose far matches weigh less
# The last threshold of essential matrices, in standard deviations of the inliers: their weights
# then suit the noise, whatever the caller's threshold is. Their median is from HALVINGS of it.
SPREAD, HALVINGS, FIRST_STEPS = 6.0, 5, 4
NO_STEPS = np.zeros(1, np.float32)  # no match is within this limit: models are scored alone
# Required number of samples without outliers: noise spoils some of them.
SPARE = 2.0
# The search ends when a model with this many times the inliers would have been found.
LARGER = 1.5


class RobustFit(NamedTuple):
    """A model that many matches support."""

    matrix: np.ndarray | None
    """(3, 3) float64, acts on (x, y, 1) with x the column and y the row; None if there is no such
    model."""
    inliers: Any
    """(N,) bool, in the library of the points: true for matches within the threshold."""
    cost: float
    """Sum over the different matches of min(1, squared residual over squared threshold)."""


class RobustFits(NamedTuple):
    """The models of several pairs of images."""

    matrices: np.ndarray
    """(B, 3, 3) float64, as in a `RobustFit`; NaN for a pair without a model."""
    inliers: Any
    """bool, concatenated over all pairs, in the library of the points."""
    offsets: np.ndarray
    """(B + 1,) int64: the matches of pair b are `inliers[offsets[b]:offsets[b + 1]]`."""
    costs: np.ndarray
    """(B,) float64, as in a `RobustFit`."""


def alone(fits: RobustFits) -> RobustFit:
    """Return the model of a batch of one pair."""
    matrix = fits.matrices[0]
    found = None if np.isnan(matrix[0, 0]) else matrix
    return RobustFit(found, fits.inliers, float(fits.costs[0]))


class Search(NamedTuple):
    """The options of a robust fit."""

    threshold: float
    confidence: float
    max_trials: int
    seed: int


class Found(NamedTuple):
    """The best model of each pair so far."""

    models: np.ndarray
    """(P, 9) float64."""
    costs: np.ndarray
    """(P,) int64, in units of 1 / `COST_ONE`; `NO_COST` where there is none."""
    supports: np.ndarray
    """(P,) int64, the number of inliers."""
    trials: np.ndarray
    """(P,) int64, the number of hypotheses."""


class Explorer:
    """The matches of a batch where kernels find them, and the search among them."""

    def __init__(self, rt: Runtime, batch: Batch, options: Search, known: np.ndarray | None = None):
        self.rt, self.batch, self.options = rt, batch, options
        self.counts = batch.spans[:, 1].astype(np.int64)
        scales = batch.to_unit[1, :, 0, 0]
        squares = np.minimum((options.threshold * scales) ** 2, MOST_SQUARE)
        self.squares = squares.astype(np.float32)
        self._known = np.zeros((1, 9)) if known is None else known
        self._given = Given(
            batch.matches,
            rt.send("robust.spans", batch.spans),
            rt.send("robust.squares", self.squares),
            rt.send("robust.known", self._known),
        )

    def explore(
        self, model: Model, planes: np.ndarray | None = None, most: int | None = None
    ) -> Found:
        """Draw samples for each pair until a better model is unlikely; refine the best ones.

        `planes` are homographies (P, 9) to start from, NaN for pairs to leave out; `most` is a
        number of trials below that of the options.
        """
        rt, size, number = self.rt, SAMPLE[model], len(self.counts)
        fitted = Model.FUNDAMENTAL if model == Model.PARALLAX else model
        costs, trials = np.full(number, NO_COST, np.int64), np.zeros(number, np.int64)
        best = Found(np.zeros((number, 9)), costs, trials.copy(), trials)
        rough = costs.copy()
        usable, given = self.counts >= size, self._given
        if planes is not None:
            usable &= np.isfinite(planes).all(axis=1)
            given = given._replace(known=rt.send("robust.planes", np.ascontiguousarray(planes)))
        active = np.flatnonzero(usable).astype(np.int32)
        done, room = 0, FIRST
        last = min(self.options.max_trials, most or self.options.max_trials)
        # Each round draws at least `GROUP` samples.
        while len(active) and done < last:
            room = min(room, -(-(last - done) // GROUP) * GROUP)
            draw = Draw(int(model), self.options.seed, done)
            hypotheses, scores = self._propose(given, active, draw, room)
            least = rt.to_numpy(scores).min(axis=1)
            promising = least < rough[active]
            rough[active] = np.minimum(rough[active], least)
            if promising.any():
                rows = np.flatnonzero(promising).astype(np.int32)
                self._improve(best, fitted, active[promising], hypotheses, scores, rows)
            done += room
            trials[active] = done
            share = best.supports[active] / self.counts[active]
            active = active[done < _wanted(share, size, self.options.confidence)]
            room = min(done, MOST)
        return best

    def _propose(self, given: Given, pairs: np.ndarray, draw: Draw, room: int) -> tuple[Any, Any]:
        """Draw `room` samples for each pair; return the best of each group, and their costs."""
        rt = self.rt
        hypotheses = rt.scratch("robust.models", (len(pairs), room // GROUP, 9))
        costs = rt.scratch("robust.costs", hypotheses.shape[:2], np.int32)
        to = rt.send("robust.pairs", pairs)
        rt.geometry.robust.propose(given, to, draw, hypotheses, costs)
        return hypotheses, costs

    def _improve(
        self,
        best: Found,
        model: Model,
        pairs: np.ndarray,
        hypotheses: Any,
        scores: Any,
        rows: np.ndarray,
    ) -> None:
        """Refine the hypotheses in the rows of some pairs, and keep those that beat `best`."""
        rt = self.rt
        chosen = rt.scratch("robust.chosen", (len(pairs), CANDIDATES, 9), np.float64)
        rt.geometry.robust.choose(hypotheses, scores, rt.send("robust.rows", rows), chosen)
        models, costs, supports = self._refined(model, chosen, pairs, COARSE)
        rank = np.argmin(costs, axis=1)  # the first of equals
        row = np.arange(len(pairs))
        better = costs[row, rank] < best.costs[pairs]
        pairs, row, rank = pairs[better], row[better], rank[better]
        best.models[pairs] = models[row, rank]
        best.costs[pairs], best.supports[pairs] = costs[row, rank], supports[row, rank]

    def finish(self, model: Model, found: Found) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return matrices (P, 3, 3), or NaN, inliers (M,) uint8 and costs (P,) float64."""
        rt, count = self.rt, self.counts
        everyone = np.arange(len(count), dtype=np.int32)
        chosen = rt.scratch("robust.chosen", (len(count), 1, 9), np.float64)
        rt.write(chosen, found.models[:, None])
        schedule = FINE if model <= Model.HOMOGRAPHY else LAST
        if model == Model.ESSENTIAL:
            schedule = LAST[:FIRST_STEPS]
        models, cost, support = self._refined(model, chosen, everyone, schedule)
        if model == Model.ESSENTIAL:
            squares = self.squares * self._spread(model, models, support) ** 2
            narrow = rt.send("robust.narrow", squares.astype(np.float32))
            self._refined(model, chosen, everyone, LAST, self._given._replace(squares=narrow))
            models, cost, support = self._refined(model, chosen, everyone, NO_STEPS)
        none = ~self.significant(model, support[:, 0], found.trials)
        inliers = rt.scratch("robust.inliers", (self.batch.matches.shape[1],), np.uint8)
        last = rt.send("robust.last", np.ascontiguousarray(models[:, 0]))
        rt.geometry.robust.mark(self._given, int(model), last, inliers)
        marks = np.array(rt.to_numpy(inliers))
        matrices = models.reshape(-1, 3, 3).copy()
        matrices[none] = np.nan
        for begin, number in self.batch.spans[none]:
            marks[begin : begin + number] = 0
        return matrices, marks, np.where(none, count, cost[:, 0] / COST_ONE)

    def significant(self, model: Model, supports: np.ndarray, trials: np.ndarray) -> np.ndarray:
        """Return which pairs have more inliers than by chance."""
        square = self.squares.astype(np.float64)
        sides = self.batch.sides + 2 * np.sqrt(square)[:, None]
        area = np.prod(sides, axis=1)
        if model in (Model.FUNDAMENTAL, Model.ESSENTIAL):  # a band along a line
            near = 2 * np.sqrt(square) * np.hypot(*sides.T)
        else:
            near = math.pi * square
        chance = np.divide(near, area, out=np.ones_like(area), where=area > near)
        return _significant(supports, self.counts, trials, chance, model)

    def _spread(self, model: Model, models: np.ndarray, support: np.ndarray) -> np.ndarray:
        """Return `SPREAD` deviations of the inliers of each pair, at most 1, the threshold.

        The median of their distances is interpolated between counts within halves of it.
        """
        rt, number = self.rt, len(self.counts)
        share = 0.5 ** np.arange(1, HALVINGS + 1)
        chosen = rt.scratch("robust.halved", (HALVINGS * number, 1, 9), np.float64)
        rt.write(chosen, np.tile(models, (HALVINGS, 1, 1)))
        squares = (share[:, None] ** 2 * self.squares).astype(np.float32).ravel()
        given = self._given._replace(
            spans=rt.send("robust.halved_spans", np.tile(self.batch.spans, (HALVINGS, 1))),
            squares=rt.send("robust.halved_squares", squares),
            known=rt.send("robust.halved_known", np.tile(self._known, (HALVINGS, 1))),
        )
        everyone = np.arange(len(squares), dtype=np.int32)
        _, _, within = self._refined(model, chosen, everyone, NO_STEPS, given)
        counts = np.concatenate((support[:, 0], within[:, 0])).reshape(-1, number)
        half = counts[0] / 2
        last = np.clip((counts >= half).sum(axis=0), 1, HALVINGS)  # the first count below a half
        many, few = (np.take_along_axis(counts, last[None] - k, 0)[0] for k in (1, 0))
        median = share[last - 1] * (1 + np.clip((half - few) / np.maximum(many - few, 1), 0, 1))
        return np.minimum(SPREAD * 1.4826 * median, 1)

    def _refined(
        self,
        model: Model,
        chosen: Any,
        pairs: np.ndarray,
        schedule: np.ndarray,
        given: Given | None = None,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        rt = self.rt
        scores = rt.scratch("robust.scores", (*chosen.shape[:2], 2), np.int32)
        to = rt.send("robust.refined_pairs", pairs)
        steps = rt.constant(schedule)
        rt.geometry.robust.refine(given or self._given, to, int(model), steps, chosen, scores)
        models, told = (np.array(rt.to_numpy(array)) for array in (chosen, scores))
        return models, told[..., 0], told[..., 1]


def _wanted(share: np.ndarray, size: int, confidence: float) -> np.ndarray:
    """Return the number of samples that rules out, with `confidence`, a much better model."""
    good = np.clip((LARGER * share) ** size, 1e-12, 1 - 1e-12)
    return SPARE * math.log(1 - confidence) / np.log1p(-good)


def _significant(
    support: np.ndarray, count: np.ndarray, trials: np.ndarray, chance: np.ndarray, model: Model
) -> np.ndarray:
    """Return which pairs have more inliers than by chance.

    If all matches were outliers, less than one such fit is expected among all subsets of the
    matches and all trials [L. Moisan and B. Stival, IJCV 57(3), 2004]. A fit to all matches also
    passes.
    """

    def log(x: np.ndarray) -> np.ndarray:  # the logarithm of (x - 1)!
        return np.array([math.lgamma(value) for value in x])

    size = SAMPLE[model]
    n, k = count.astype(np.float64), support.astype(np.float64)
    subsets = log(n + 1) - log(k + 1) - log(n - k + 1)
    with np.errstate(divide="ignore"):
        accidents = subsets + np.log(np.maximum(trials, 1)) + (k - size) * np.log(chance)
    # Samples of these leave several models.
    several = model in (Model.FUNDAMENTAL, Model.ESSENTIAL, Model.POSE)
    return (support >= size + several) & ((accidents < 0) | (support == count))
