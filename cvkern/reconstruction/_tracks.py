"""Tracks: the places in several photographs that show one point of the scene."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cvkern.reconstruction._pairs import Pair
from cvkern.reconstruction._photographs import Keypoints


class Tracks(NamedTuple):
    """Places of the same point: sorted by the track, then by the photograph."""

    track: np.ndarray
    """(O,)."""
    view: np.ndarray
    """(O,): the photograph; once at most in a track."""
    where: np.ndarray
    """(x, y), (O, 2)."""
    color: np.ndarray
    """(O, 3) uint8."""
    total: int
    """Number of tracks."""


def find_tracks(found: list[Keypoints], pairs: list[Pair]) -> Tracks:
    """Join matches to tracks; a join that would put two places of a photograph into one is refused.

    Where joins conflict, those of the pairs with most matches come first.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    sizes = np.array([len(k.places) for k in found])
    starts = np.cumsum(sizes) - sizes
    views = np.repeat(np.arange(len(found)), sizes)
    total = int(sizes.sum())
    ordered = sorted(pairs, key=lambda p: (-len(p.places), p.first, p.second))
    joins = np.concatenate(
        [np.zeros((0, 2), int)] + [p.places + starts[[p.first, p.second]] for p in ordered]
    )
    ones = np.ones(len(joins), bool)
    graph = coo_matrix((ones, (joins[:, 0], joins[:, 1])), shape=(total, total))
    labels = connected_components(graph, directed=False)[1].astype(np.int64)
    # A conflict: one label twice in a photograph.
    key = labels * len(found) + views
    _, where, counts = np.unique(key, return_inverse=True, return_counts=True)
    joined = np.bincount(labels, minlength=labels.max(initial=-1) + 1)[labels] > 1
    wrong = np.zeros(labels.max(initial=-1) + 1, bool)
    wrong[labels[joined & (counts[where.reshape(-1)] > 1)]] = True
    labels = _split(joins[wrong[labels[joins[:, 0]]]], labels, views)
    sizes = np.bincount(labels)
    kept = np.flatnonzero(sizes[labels] > 1)
    order = kept[np.lexsort((views[kept], labels[kept]))]
    _, track = np.unique(labels[order], return_inverse=True)
    track = track.reshape(-1)
    places = np.concatenate([np.zeros((0, 2))] + [k.places for k in found])
    colors = np.concatenate([np.zeros((0, 3), np.uint8)] + [k.colors for k in found])
    return Tracks(track, views[order], places[order], colors[order], int(track.max(initial=-1)) + 1)


def _split(joins: np.ndarray, labels: np.ndarray, views: np.ndarray) -> np.ndarray:
    """Return labels in which the given joins are made one by one, unless they conflict."""
    labels = labels.copy()
    nodes = np.unique(joins)
    fresh = len(labels)
    members = {int(n): {int(views[n])} for n in nodes}
    groups = {int(n): [int(n)] for n in nodes}
    group = {int(n): int(n) for n in nodes}
    for a, b in joins.tolist():
        one, other = group[a], group[b]
        if one == other or members[one] & members[other]:
            continue
        if len(groups[one]) < len(groups[other]):
            one, other = other, one
        members[one] |= members.pop(other)
        for n in groups[other]:
            group[n] = one
        groups[one] += groups.pop(other)
    for n in nodes.tolist():
        labels[n] = fresh + group[n]
    return labels
