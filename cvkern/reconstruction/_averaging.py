"""Turns of all photographs at once, from the turns of pairs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cvkern.panorama.adjustment import turn as turn_of
from cvkern.reconstruction._solving import solve

ROUNDS = 30  # steps: the first half for the sum of angles, the others for a loss that levels off
LEVEL = np.radians(5.0)  # angle at which this loss levels off
LEAST = np.radians(0.05)  # smaller angles weigh as much as this one
SWEEPS = 2  # times that all photographs are asked again before the steps
STILL = 1e-6  # radians: the steps end when all are smaller


class Turns(NamedTuple):
    """Turns of photographs, from a common world to their axes."""

    rotations: np.ndarray
    """(N, 3, 3); NaN for a photograph without a pair. Each group of photographs that pairs join
    has a world of its own."""
    off: np.ndarray
    """By which angle the turn of each pair differs from these, (P,), radians."""


def average_turns(count: int, ends: np.ndarray, turns: np.ndarray, numbers: np.ndarray) -> Turns:
    """Return the turns of `count` photographs that agree best with the turns (P, 3, 3) of pairs.

    The turn of a pair brings the axes of the first photograph of `ends` (P, 2) to those of the
    second; `numbers` (P,) tells how many matches each has. Wrong pairs weigh less and less
    [Chatterjee and Govindu 2013].
    """
    rotations, held = _one_by_one(count, ends, turns, numbers)
    free = np.flatnonzero(~held & np.isin(np.arange(count), ends))
    place = np.full(count, len(free))
    place[free] = np.arange(len(free))
    first, second = place[ends].T
    weights = np.sqrt(numbers)
    for n in range(ROUNDS if len(free) else 0):
        gaps = _gaps(rotations, ends, turns)
        angles = np.linalg.norm(gaps, axis=1)
        if n < ROUNDS // 2:
            now = weights / np.maximum(angles, LEAST)
        else:
            now = weights / (1 + (angles / LEVEL) ** 2) ** 2
        # The step of the second photograph less that of the first is the gap.
        square, right = np.zeros((len(free) + 1,) * 2), np.zeros((len(free) + 1, 3))
        for a, b, sign in ((first, first, 1), (second, second, 1), (first, second, -1)):
            np.add.at(square, (a, b), sign * now)
            if sign < 0:
                np.add.at(square, (b, a), -now)
        np.add.at(right, second, now[:, None] * gaps)
        np.add.at(right, first, -now[:, None] * gaps)
        matrix = square[:-1, :-1] + 1e-9 * np.eye(len(free)) * square.max()
        steps = np.stack([_solved(matrix, right[:-1, k]) for k in range(3)], axis=1)
        rotations[free] = rotations[free] @ turn_of(steps)
        if n >= ROUNDS // 2 and np.abs(steps).max() < STILL:
            break
    off = np.linalg.norm(_gaps(rotations, ends, turns), axis=1)
    lonely = ~np.isin(np.arange(count), ends)
    rotations[lonely] = np.nan
    return Turns(rotations, off)


def _solved(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    found = solve(matrix, right)
    return np.zeros(len(right)) if found is None else found


def _gaps(rotations: np.ndarray, ends: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Return the turns (P, 3) that are left between pairs and photographs."""
    from scipy.spatial.transform import Rotation

    first, second = rotations[ends[:, 0]], rotations[ends[:, 1]]
    return Rotation.from_matrix(second.transpose(0, 2, 1) @ turns @ first).as_rotvec()


def _one_by_one(
    count: int, ends: np.ndarray, turns: np.ndarray, numbers: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return first turns, and which photographs are the first of a group.

    The photograph with most pairs to those that are known is the next one. Of the turns that these
    pairs give it, it takes the one with which the others agree best.
    """
    rotations = np.tile(np.eye(3), (count, 1, 1))
    known, begun = np.zeros((2, count), bool)
    both = np.concatenate((ends, ends[:, ::-1]))
    moves = np.concatenate((turns, turns.transpose(0, 2, 1)))
    strength = np.bincount(ends.ravel(), np.repeat(numbers, 2), count)
    # Each round adds one photograph.
    while not known.all():
        open_ = known[both[:, 0]] & ~known[both[:, 1]]
        links = np.bincount(both[open_, 1], minlength=count)
        if not links.any():
            k = int(np.argmax(np.where(known, -1.0, strength)))
            known[k] = begun[k] = True
            continue
        k = int(np.argmax(np.where(links == links.max(), strength, -1.0)))
        own = np.flatnonzero(open_ & (both[:, 1] == k))
        rotations[k] = _likeliest(moves[own] @ rotations[both[own, 0]])
        known[k] = True
    # The first ones had few pairs: all are asked again.
    for _ in range(SWEEPS):
        for k in np.flatnonzero(~begun):
            own = np.flatnonzero(both[:, 1] == k)
            rotations[k] = _likeliest(moves[own] @ rotations[both[own, 0]])
    return rotations, begun


def _likeliest(told: np.ndarray) -> np.ndarray:
    """Return the one of several turns (N, 3, 3) with which the others agree best."""
    off = angles_between(told[:, None], told[None])
    return told[int(np.argmin(np.minimum(off, LEVEL).sum(axis=1)))]


def angles_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the angles of the turns between rotations (..., 3, 3), radians."""
    # The length of A - B is sqrt(8) times the sine of half the angle.
    return 2 * np.arcsin(np.minimum(np.linalg.norm(a - b, axis=(-2, -1)) / np.sqrt(8), 1.0))
