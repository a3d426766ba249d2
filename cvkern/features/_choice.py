"""Selection of the best points by (response, position), optionally spread over the image."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

GROUP = 16  # responses of which only the largest is looked at first


class Grid(NamedTuple):
    """Squares of an image, over which points are spread."""

    side: float
    """Pixels."""
    across: int
    """Squares of a row."""
    squares: int
    """All squares: 1 if points are not spread."""


def grid_of(shape: tuple[int, ...], count: int | None) -> Grid:
    """Return about `count` / 4 squares, or one for the whole image."""
    if not count:
        return Grid(float(shape[0] + shape[1]), 1, 1)
    side = max(1.0, math.sqrt(4.0 * shape[0] * shape[1] / count))
    across = int(shape[1] / side) + 1
    return Grid(side, across, across * (int(shape[0] / side) + 1))


def best(
    responses: np.ndarray,
    points: np.ndarray,
    shape: tuple[int, int],
    count: int | None,
    spread: bool,
) -> np.ndarray:
    """Return the indices, ascending, of the `count` best of points that are in a stated order.

    Of equal responses the first wins. Spread means: the image is cut into about `count` / 4
    squares, and the best of every square come first, then their second best, and so on.
    """
    if count is None or count >= len(responses):
        return np.arange(len(responses))
    if not count:
        return np.empty(0, np.int64)
    if not spread:
        return np.flatnonzero(_strongest(responses, count))
    grid = grid_of(shape, count)
    row, column = (points.astype(np.float64) / grid.side).astype(np.int64).T
    square = row * grid.across + column
    order = np.argsort(-responses, kind="stable")
    # NumPy sorts numbers of 16 bits by counting.
    small = square[order].astype(np.min_scalar_type(square.max()))
    order = order[np.argsort(small, kind="stable")]
    begins = np.flatnonzero(np.diff(square[order], prepend=-1))
    lengths = np.diff(begins, append=len(order))
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order)) - np.repeat(begins, lengths)
    # All points of low ranks are kept, and the strongest ones of the rank that is too much.
    last = int(np.searchsorted(np.cumsum(np.bincount(rank)), count, side="right"))
    kept = rank < last
    left = np.flatnonzero(rank == last)
    missing = count - np.count_nonzero(kept)
    if missing:
        kept[left[_strongest(responses[left], missing)]] = True
    return np.flatnonzero(kept)


def _strongest(responses: np.ndarray, count: int) -> np.ndarray:
    """Return, as booleans, the `count` largest of more responses; of equal ones the first."""
    large = responses
    if len(responses) >= GROUP * count:
        # At least `count` responses reach the `count`-th largest maximum of groups.
        whole = responses[: len(responses) // GROUP * GROUP].reshape(GROUP, -1).max(axis=0)
        large = responses[responses >= np.partition(whole, -count)[-count]]
    least = np.partition(large, -count)[-count]
    kept = responses > least
    equal = np.flatnonzero(responses == least)
    kept[equal[: count - np.count_nonzero(kept)]] = True
    return kept
