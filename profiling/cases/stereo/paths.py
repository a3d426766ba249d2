"""Semi-global aggregation of stored matching costs, and the winner among them."""

from __future__ import annotations

from typing import Any

import numpy as np

import cvkern
from cvkern.kernels.codes.stereo import LARGEST_MATCH_COST
from profiling.case import Case, Peer, Shape, Work, unequal

from .matching import disparities

SIZES = ("1024x440",)  # for 128 disparities
P1, P2 = 20, 80
MOST = LARGEST_MATCH_COST


def volume(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    """Make costs of noise, uint8."""
    return rng.integers(0, MOST, (*shape, disparities(shape)), np.uint8, endpoint=True)


def sums(costs: np.ndarray) -> np.ndarray:
    """Return the sums over eight paths: rows of all pixels' disparities at a time."""
    total = np.zeros(costs.shape, np.uint16)
    for turned, out in ((costs, total), (costs.swapaxes(0, 1), total.swapaxes(0, 1))):
        for shift in (-1, 0, 1) if out is total else (0,):
            for rows in (range(len(turned)), range(len(turned))[::-1]):
                line = np.zeros(turned.shape[1:], np.int16)
                for y in rows:
                    line = _step(_shifted(line, shift), turned[y])
                    out[y] += line.astype(np.uint16)
    return total


def _step(before: np.ndarray, costs: np.ndarray) -> np.ndarray:
    """Return L of the next pixels; that of the first ones, before which there is 0, is C."""
    least = before.min(axis=1, keepdims=True)
    best = np.minimum(before, least + P2)
    np.minimum(best[:, 1:], before[:, :-1] + P1, out=best[:, 1:])
    np.minimum(best[:, :-1], before[:, 1:] + P1, out=best[:, :-1])
    return best - least + costs


def _shifted(line: np.ndarray, shift: int) -> np.ndarray:
    """Return, of the row before, what comes before each pixel on a path."""
    if shift == 0:
        return line
    moved = np.roll(line, shift, axis=0)
    moved[0 if shift > 0 else -1] = 0
    return moved


def winners(costs: np.ndarray) -> np.ndarray:
    """Return the disparities, with the parabola's offset, in float64."""
    k = costs.argmin(axis=2)
    inner = (k > 0) & (k < costs.shape[2] - 1)
    at = np.where(inner, k, 1)[..., None]
    a, c, b = (np.take_along_axis(costs, at + n, 2)[..., 0].astype(float) for n in (-1, 0, 1))
    sharp = a + b - 2 * c
    return k + np.where(inner, (a - b) / np.where(sharp > 0, 2 * sharp, 1), 0)


def furthest(ours: tuple[np.ndarray, ...], theirs: tuple[np.ndarray, ...]) -> float:
    """Return the largest difference, in pixels."""
    (a,), (b,) = ours, theirs
    return float(np.abs(a - b).max()) if a.shape == b.shape else np.inf


def _case(name: str, title: str, bytes_per_cost: int, operations: float, **rest: Any) -> Case:
    return Case(
        name=name,
        title=title,
        image=volume,
        bytes_per_pixel=128 * bytes_per_cost,
        operations_per_pixel=128 * operations,
        work=Work("disparities", np.size),
        sizes=SIZES,
        most_inputs=2,
        margin=0,
        **rest,
    )


CASES = (
    _case(
        "aggregate_semi_global",
        "Semi-global aggregation of 128 stored costs a pixel, 8 paths, uint8",
        3,
        8 * 7,
        call=lambda costs: cvkern.aggregate_semi_global(costs, P1, P2),
        oracle=sums,
        oracle_name="NumPy, a row of every path at a time",
        difference=unequal,
        tolerance=0.0,
        peers=(Peer("NumPy", "numpy", lambda _, costs: sums(costs)),),
    ),
    _case(
        "winner_take_all",
        "Winner of 128 stored costs a pixel, between the pixels, uint8",
        1,
        2,
        call=lambda costs: cvkern.winner_take_all(costs).disparity,
        oracle=winners,
        oracle_name="NumPy in float64",
        difference=furthest,
        tolerance=2.0**-17,  # float32 of a disparity below 128
        peers=(Peer("NumPy", "numpy", lambda np, costs: np.argmin(costs, 2), note="whole pixels"),),
    ),
)
