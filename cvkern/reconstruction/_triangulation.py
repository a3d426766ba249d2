"""Points of many tracks at once, from pairs of their rays."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

ATTEMPTS = 12  # pairs of rays of a track


class Rays(NamedTuple):
    """Rays of sightings, sorted by their track."""

    track: np.ndarray
    """(O,)."""
    eyes: np.ndarray
    """(O, 3), where they begin."""
    ahead: np.ndarray
    """(O, 3), of length 1."""
    view: np.ndarray
    """(O,)."""


class Found(NamedTuple):
    """Points of tracks."""

    tracks: np.ndarray
    """(P,)."""
    points: np.ndarray
    """(P, 3)."""


def widest_angles(rays: Rays, count: int) -> np.ndarray:
    """Return the angle between two rays of each track that are far apart, (count,).

    They are the ray farthest from the first one, and the ray farthest from that. The angle is 0 for
    tracks with fewer than two rays.
    """
    widest = np.zeros(count)
    if not len(rays.track):
        return widest
    starts, place, _ = _spans(rays.track)
    off = _between(rays.ahead, rays.ahead[starts][place])
    # The farthest ray; of several, the last.
    best = off == np.maximum.reduceat(off, starts)[place]
    farthest = np.maximum.reduceat(np.where(best, np.arange(len(off)), -1), starts)
    off = _between(rays.ahead, rays.ahead[farthest][place])
    widest[rays.track[starts]] = np.maximum.reduceat(off, starts)
    return widest


def _spans(track: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return where sorted tracks begin, the number of each ray's track, and their sizes."""
    new = np.ones(len(track), bool)
    new[1:] = track[1:] != track[:-1]
    starts = np.flatnonzero(new)
    return starts, np.cumsum(new) - 1, np.diff(np.append(starts, len(track)))


def _between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return angles between unit vectors; exact for small ones."""
    return 2 * np.arcsin(np.minimum(lengths_of(a - b) / 2, 1.0))


def lengths_of(vectors: np.ndarray) -> np.ndarray:
    """Return the lengths of vectors (N, D)."""
    return np.sqrt(np.einsum("ni,ni->n", vectors, vectors))


def triangulate(
    rays: Rays,
    least_angle: float,
    error: float,
    errors: Callable[[np.ndarray], np.ndarray],
    seed: int,
) -> Found:
    """Find a point for each track that at least two rays fit, with a wide enough angle.

    Several pairs of rays of a track are tried. The one that most rays fit wins, and among these the
    one with the least sum of distances. `errors` returns the distance in pixels of each ray from a
    point (O, 3).
    """
    starts, place, counts = _spans(rays.track)
    names = rays.track[starts]
    best = np.full((len(names), 3), np.nan)
    fits, costs = np.ones(len(names), int), np.full(len(names), np.inf)
    rng = np.random.default_rng(seed)
    for attempt in range(ATTEMPTS):
        first, second = _pair(attempt, counts, rng)
        if not (second >= 0).any():
            break
        a, b = starts + first, starts + np.maximum(second, 0)
        points, angles = _between_rays(rays, a, b)
        good = (second >= 0) & (angles >= least_angle) & np.isfinite(points).all(axis=1)
        points[~good] = np.nan
        off = errors(points[place])
        near = off <= error
        number = np.bincount(place[near], minlength=len(names))
        cost = np.bincount(place, np.where(near, off, 0), len(names))
        both = near[a] & near[b]
        better = good & both & ((number > fits) | ((number == fits) & (cost < costs)))
        best[better], fits[better], costs[better] = points[better], number[better], cost[better]
    kept = np.isfinite(best[:, 0])
    return Found(names[kept], best[kept])


def _pair(
    attempt: int, counts: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Return two rays of each track, or -1 for the second of a track whose pairs are done."""
    # Short tracks go through all pairs (0, 1), (0, 2), (1, 2), (0, 3), ...; long ones draw.
    second = int((1 + np.sqrt(1 + 8 * attempt)) // 2)
    first = attempt - second * (second - 1) // 2
    drawn = rng.random((2, len(counts)))
    a = np.floor(drawn[0] * counts).astype(int)
    b = np.floor(drawn[1] * np.maximum(counts - 1, 1)).astype(int)
    b += b >= a
    long = counts * (counts - 1) // 2 > ATTEMPTS
    one = np.where(long, a, first)
    other = np.where(long, b, np.where(second < counts, second, -1))
    return np.where(other >= 0, one, 0), other


def _between_rays(rays: Rays, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the point in the middle between two rays, and their angle."""
    gap = rays.eyes[b] - rays.eyes[a]
    u, v = rays.ahead[a], rays.ahead[b]
    along = (u * v).sum(axis=1)
    with np.errstate(all="ignore"):
        square = 1 - along * along
        s = ((gap * u).sum(axis=1) - along * (gap * v).sum(axis=1)) / square
        t = (along * (gap * u).sum(axis=1) - (gap * v).sum(axis=1)) / square
        middle = (rays.eyes[a] + s[:, None] * u + rays.eyes[b] + t[:, None] * v) / 2
    return middle, _between(u, v)
