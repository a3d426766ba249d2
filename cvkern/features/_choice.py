"""Selection of the best points by (response, position), optionally spread over the image."""

from __future__ import annotations

import numpy as np


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
    if not spread and count:
        least = np.partition(responses, -count)[-count]
        kept = responses > least
        equal = np.flatnonzero(responses == least)
        kept[equal[: count - np.count_nonzero(kept)]] = True
        return np.flatnonzero(kept)
    order = np.argsort(-responses, kind="stable")
    if spread and count:
        side = max(1.0, np.sqrt(4.0 * shape[0] * shape[1] / count))
        across = int(shape[1] / side) + 1
        row, column = (points[order] / side).astype(np.int64).T
        square = row * across + column
        by_square = np.argsort(square, kind="stable")
        ordered = square[by_square]
        begins = np.flatnonzero(np.r_[True, ordered[1:] != ordered[:-1]])
        lengths = np.diff(np.r_[begins, len(ordered)])
        rank = np.empty(len(order), np.int64)
        rank[by_square] = np.arange(len(order)) - np.repeat(begins, lengths)
        order = order[np.argsort(rank, kind="stable")]
    return np.sort(order[:count])
