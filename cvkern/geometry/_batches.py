"""Batches of pairs as callers give them, and the options of robust fits: their checks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import as_items, check_integer, check_number, check_positive
from cvkern._runtime import Runtime, runtime
from cvkern.geometry._matches import Batch
from cvkern.geometry._points import all_on_host, check_pairs
from cvkern.geometry.robust import RobustFits, Search
from cvkern.kernels.codes.geometry import MAX_MATCHES


class Batched(NamedTuple):
    """The points of several pairs on the host, and how to give results back."""

    rt: Runtime
    points: list[tuple[np.ndarray, np.ndarray]]
    """(row, column), float64."""
    offsets: np.ndarray

    def fits(
        self, batch: Batch, matrices: np.ndarray, marks: np.ndarray, costs: np.ndarray
    ) -> RobustFits:
        """Give marks (M,) back in the caller's order and library."""
        kept = batch.places >= 0
        # Matches that are not finite are outliers as well.
        inliers = (marks[batch.places] != 0) & kept
        if not kept.all():
            costs = costs + np.diff(np.concatenate(([0], np.cumsum(~kept)))[self.offsets])
        return RobustFits(matrices, self.rt.give(inliers), self.offsets, costs)


def check_batch(pairs: Sequence[tuple[Any, Any]]) -> Batched:
    """Return the points of a batch, each pair as many in the one image as in the other."""
    rule = "pairs of two lists of points"
    both = [as_items(pair, "pairs", rule) for pair in as_items(pairs, "pairs", rule)]
    if any(len(pair) != 2 for pair in both):
        raise ValueError(f"pairs must be {rule}, got one of another length")
    checked = []
    for n, (a, b) in enumerate(both):
        try:
            checked.append(check_pairs(a, b))
        except (TypeError, ValueError) as error:
            if len(both) == 1:  # mostly from a function of one pair
                raise
            raise type(error)(f"pairs[{n}]: {error}") from None
    if not checked:
        raise ValueError("pairs must not be empty, got none")
    return batch_of(checked, "points0")


def batch_of(checked: list[tuple[Any, Any]], name: str) -> Batched:
    """Take points that are as many in the one list as in the other to the host."""
    for a, _ in checked:
        if len(a) > MAX_MATCHES:
            raise ValueError(f"{name} must be at most {MAX_MATCHES}, got {len(a)}")
    offsets = np.cumsum([0] + [len(a) for a, _ in checked], dtype=np.int64)
    rt = runtime(*(points for pair in checked for points in pair))
    sides = (all_on_host(rt, list(side)) for side in zip(*checked, strict=True))
    return Batched(rt, list(zip(*sides, strict=True)), offsets)


def search_options(threshold: Any, confidence: Any, max_trials: Any, seed: Any) -> Search:
    threshold = check_positive(threshold, "threshold")
    confidence = check_number(confidence, "confidence", low=0)
    if not 0 < confidence < 1:
        raise ValueError(f"confidence must be in (0, 1), got {confidence:g}")
    return Search(
        threshold,
        confidence,
        check_integer(max_trials, "max_trials", 1, 2**30),
        check_integer(seed, "seed", 0, 2**31 - 1),
    )
