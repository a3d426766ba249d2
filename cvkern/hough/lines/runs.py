"""Segments along lines: runs of edge points without gaps, whose points stay in kernel memory.

The host computes what each line or segment has once; kernels do the work for each point.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cvkern._runtime import Runtime
from cvkern.hough.lines._support import AIM, codes_of, normal_of, vote_listed
from cvkern.hough.lines._tables import SUBPIXEL
from cvkern.kernels.codes.hough import DENSITY, DIRECTION_FACTOR

# Largest angles between a gradient and the normal of its line, in the passes of each fit: narrow
# ones first. The second fit of the first round joins parts of lines that are too long for one bin.
_FIRST_AIMS = (AIM,), (AIM / 4, AIM / 2, AIM)
_AIMS = ((AIM / 4, AIM),)
_WORTH = 0.2  # share of the segments so far; a round that finds fewer is the last


class Rule(NamedTuple):
    """What a segment is; pixels."""

    min_length: float
    max_gap: float
    distance: float


class _Edges(NamedTuple):
    """Edge points as kernel arrays."""

    points: Any
    """Row and column, (N, 2) float32."""
    directions: Any
    """Directions of the gradients, (N,) float32."""
    codes: Any
    """Codes of the directions, (N,) int32."""
    none: Any
    """-1 for each point: no line before the first, (N,) int32."""
    number: int


class _Runs(NamedTuple):
    """Runs of points along lines as kernel arrays."""

    order: Any
    """The points, sorted by line and place along it."""
    runs: Any
    """Where a run begins in this order, and its number of points, (S, 2) int32."""
    chosen: Any
    """Whether a point is in one of the runs, (N,) uint8."""
    number: int


def find_segments(
    rt: Runtime, points: Any, directions: Any, size: tuple[int, int], rule: Rule
) -> np.ndarray:
    """Return the ends of segments (S, 4) of edges in an image of `size`; kernel arrays."""
    segments = [np.zeros((0, 4))]
    number = int(points.shape[0])
    none = rt.send("runs.none", np.full(number, -1, np.int32))
    turn, worth = 0, True
    while number and worth:
        fits = _AIMS if turn else _FIRST_AIMS
        fixed = rt.scratch("runs.fixed", (number, 2), np.int32)
        codes = rt.scratch("runs.codes", (number,), np.int32)
        rt.hough.lines.runs.prepare(points, directions, float(SUBPIXEL), fixed, codes)
        edges = _Edges(points, directions, codes, none[:number], number)
        count = rt.send("runs.count", np.array([number], np.int32))
        least = DENSITY * rule.min_length
        theta, rho = vote_listed(rt, fixed, count, directions, size, least)
        ends, found = np.zeros((0, 4)), None
        for fit, aims in enumerate(fits, 1):
            found = _supported(rt, edges, theta, rho, rule, aims)
            if not found.number:
                break
            theta, rho, first, numbers = _fitted(rt, edges, found)
            if fit == len(fits):
                ends = _ends(rt, edges, found, theta, rho, first)
            else:  # The longest part of a line comes first: it takes the points of the others.
                longest = np.argsort(-numbers, kind="stable")
                theta, rho = theta[longest], rho[longest]
        if found is None or not found.number:
            break
        worth = found.number >= _WORTH * sum(map(len, segments))
        segments.append(ends)
        if worth:
            points, directions, number = _left(rt, edges, found, turn % 2)
        turn += 1
    return np.concatenate(segments)


def _supported(
    rt: Runtime,
    edges: _Edges,
    theta: np.ndarray,
    rho: np.ndarray,
    rule: Rule,
    aims: Sequence[float],
) -> _Runs:
    """Return the long and dense runs of points along the lines.

    A stronger line that only crosses a segment must not take points from it: at 10 degrees it would
    take 11 pixels. So the first pass gives a point only to a line that is nearly across its
    gradient. A point of a run keeps its line, and the others choose again with the next, wider aim.
    """
    number = edges.number
    order = rt.scratch("runs.order", (2 * number,), np.int32)
    chosen = rt.scratch("runs.chosen", (number,), np.uint8)
    runs = rt.scratch("runs.runs", (number, 2), np.int32)
    if not len(theta):
        return _Runs(order, runs, chosen, 0)
    cosine, sine = np.cos(theta), np.sin(theta)
    lines, exact, normals = rt.send_all(
        "runs.lines",
        np.stack((cosine, sine, rho)).astype(np.float32),
        np.stack((cosine, sine)),
        codes_of(theta).astype(np.int32),
    )
    labels = rt.scratch("runs.labels", (number,), np.int32)
    total = rt.scratch("runs.total", (1,), np.int32)
    after = rt.scratch("runs.after", (number,), np.int32)
    limits = rule.max_gap, rule.min_length
    module = rt.hough.lines.runs
    for turn, aim in enumerate(aims):
        if turn:
            module.hold(labels, chosen, after)
        rt.hough.lines.segments.claim(
            edges.points, edges.codes, after if turn else edges.none, lines, normals,
            float(np.float32(rule.distance)), math.floor(aim * DIRECTION_FACTOR), labels,
        )  # fmt: skip
        module.cut(
            edges.points, edges.codes, labels, exact, normals, limits, order, runs, chosen, total
        )
    return _Runs(order, runs, chosen, int(rt.to_numpy(total)[0]))


def _fitted(rt: Runtime, edges: _Edges, found: _Runs) -> tuple[np.ndarray, ...]:
    """Fit a line to each run: angle, distance, the first point's direction, number of points."""
    sums = rt.scratch("runs.sums", (found.number, 8), np.float64)
    rt.hough.lines.runs.add_up(edges.points, edges.directions, found.order, found.runs, sums)
    y, x, first, down, along, yy, xx, xy = rt.to_numpy(sums).T
    number = rt.to_numpy(found.runs[: found.number])[:, 1].astype(np.float64)
    down, along = down / number, along / number
    covariance = yy - number * down**2, xx - number * along**2, xy - number * down * along
    theta = normal_of(*covariance)
    rho = (x + along) * np.cos(theta) + (y + down) * np.sin(theta)
    return theta, rho, first.copy(), number


def _ends(
    rt: Runtime, edges: _Edges, found: _Runs, theta: np.ndarray, rho: np.ndarray, first: np.ndarray
) -> np.ndarray:
    """Return the ends of the runs on their lines, (S, 4)."""
    c, s = np.cos(theta), np.sin(theta)
    ends = rt.scratch("runs.ends", (found.number, 2), np.float64)
    lines = rt.send("runs.exact", np.stack((c, s)))
    rt.hough.lines.runs.reach(edges.points, found.order, found.runs, lines, ends)
    least, most = rt.to_numpy(ends).T
    # Choose the first end so that the brighter side is always on the left.
    turned = np.cos(first - theta) < 0
    places = [np.where(turned, a, b) for a, b in ((most, least), (least, most))]
    rows_columns = [(rho * s + t * c, rho * c - t * s) for t in places]
    return np.stack([*rows_columns[0], *rows_columns[1]], axis=1)


def _left(rt: Runtime, edges: _Edges, found: _Runs, turn: int) -> tuple[Any, Any, int]:
    """Return points and directions that are in no run, and their number."""
    points = rt.scratch(f"runs.points.{turn}", (edges.number, 2))
    directions = rt.scratch(f"runs.directions.{turn}", (edges.number,))
    total = rt.scratch("runs.total", (1,), np.int32)
    given = edges.points, edges.directions, found.chosen
    rt.hough.lines.runs.keep(*given, points, directions, total)
    number = int(rt.to_numpy(total)[0])
    return points[:number], directions[:number], number
