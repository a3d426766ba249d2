"""The points that support a line, their positions along it, and the line that fits them best."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cvkern._checks import check_accumulator
from cvkern._runtime import Runtime
from cvkern.hough.lines._tables import (
    SUBPIXEL,
    cast_votes,
    direction_windows,
    line_tables,
    reach,
    subpixel_points,
)
from cvkern.hough.lines.peaks import peak_bins
from cvkern.hough.lines.votes import suggest_line_bins
from cvkern.kernels.codes.hough import DIRECTION_FACTOR, DIRECTIONS

AIM = math.pi / 8  # radians: largest angle between a gradient and the normal of its line
_AIM_OF_VOTES = math.radians(3)  # the same for votes, where more would cost time and add clutter
_LOCALISATION = 0.25  # pixels: standard deviation of sub-pixel edges in photographs
_LENGTH = 320  # pixels: lines up to this length fall into one bin; longer ones into several
_APART = 3  # bins of rho and theta between the peaks of one round
FITS = 2  # fits of a line; each uses the points that are on the line of the previous fit
CHANGES = 0, 1  # times that a point may move to the next line, in each of the fits of a segment
_TUKEY = 4.685 / 0.6745  # farthest point that counts, in medians: 95 % efficient for normal errors
_LEAST_SCALE = 0.1  # pixels: the farthest point that counts is at least this far away
DENSITY = 0.6  # least points per pixel of a segment; a thin edge has 0.7 to 1


class Runs(NamedTuple):
    """Points sorted by line and by position along the line, cut into runs at the gaps."""

    order: np.ndarray  # indices of the sorted points
    along: np.ndarray  # position of each sorted point along its line
    begin: np.ndarray  # index of the first sorted point of each run
    end: np.ndarray  # index after the last sorted point of each run
    line: np.ndarray  # line of each run


def vote(
    rt: Runtime, points: np.ndarray, directions: np.ndarray, size: tuple[int, int], least: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return angle and distance of the lines with at least `least` votes."""
    step, theta = suggest_line_bins(size, _LOCALISATION, length=_LENGTH)
    distances = reach(size, step)
    shape = (2 * distances + 1, len(theta))
    check_accumulator(shape, "votes")
    votes = rt.scratch("detect.votes", shape, np.int32)
    found = subpixel_points(rt, points, size)
    angles = theta.tobytes()
    tables = line_tables(angles, step, size, parts=SUBPIXEL)
    windows = direction_windows(angles, _AIM_OF_VOTES)
    cast_votes(rt, found, tables, windows, directions, None, 0, votes)
    row, column = peak_bins(rt, votes, math.ceil(least) - 1, _APART, _APART, True)
    return theta[column], step * (row - distances)


def claim(
    rt: Runtime,
    points: np.ndarray,
    directions: np.ndarray,
    theta: np.ndarray,
    rho: np.ndarray,
    distance: float,
    tolerance: float,
    after: np.ndarray | None = None,
) -> np.ndarray:
    """Return for each point the first line that it is on, after line `after`.

    The result is the number of lines if the point is on none of them.
    """
    if not len(points) or not len(theta):
        return np.full(len(points), len(theta))
    labels = rt.scratch("segments.labels", (len(points),), np.int32)
    past = np.full(len(points), -1) if after is None else after
    rt.hough.lines.segments.claim(
        rt.adopt(points),
        rt.adopt(_codes(directions), np.int32),
        rt.adopt(past, np.int32),
        rt.adopt(np.stack((np.cos(theta), np.sin(theta), rho))),
        rt.adopt(_codes(theta), np.int32),
        float(np.float32(distance)),
        math.floor(min(tolerance, math.pi) * DIRECTION_FACTOR),
        labels,
    )
    return rt.to_numpy(labels).copy()


def _codes(angles: np.ndarray) -> np.ndarray:
    """Return the direction codes of angles, computed as in the kernels."""
    turned = angles.astype(np.float32) * np.float32(DIRECTION_FACTOR) + np.float32(0.5)
    return np.floor(turned).astype(np.int64) & (DIRECTIONS - 1)


def runs(
    points: np.ndarray,
    labels: np.ndarray,
    theta: np.ndarray,
    max_gap: float,
    side: np.ndarray | None = None,
) -> Runs:
    """Cut the points of each line into runs at gaps, separately for each `side`, 0 or 1."""
    claimed = np.flatnonzero(labels < len(theta))
    line = labels[claimed].astype(np.intp)
    y, x = points[claimed].T.astype(np.float64)
    along = y * np.cos(theta)[line] - x * np.sin(theta)[line]
    key = 2 * line + (0 if side is None else side[claimed])
    order = _order(key, along)
    claimed, along, key = claimed[order], along[order], key[order]
    cut = (np.diff(key) != 0) | (np.diff(along) > max_gap)
    inner = np.flatnonzero(cut) + 1
    bounds = np.concatenate(([0], inner, [len(key)])) if len(key) else np.zeros(1, np.intp)
    return Runs(claimed, along, bounds[:-1], bounds[1:], key[bounds[:-1]] // 2)


def _order(key: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Return the order by key, then by position; positions within 2^-14 pixels keep their order.

    NumPy sorts 16-bit numbers by counting, so a sort by each digit is faster than one by values.
    """
    place = np.rint((along + 2.0**17) * 2.0**14).astype(np.uint32)  # no line is longer than 2^17
    order = np.argsort(place.astype(np.uint16), kind="stable")
    digits = [place >> 16, key]
    if len(key) and key.max() >> 16:
        digits.append(key >> 16)
    for digit in digits:
        order = order[np.argsort(digit.astype(np.uint16)[order], kind="stable")]
    return order


def supported(
    rt: Runtime,
    points: np.ndarray,
    directions: np.ndarray,
    theta: np.ndarray,
    rho: np.ndarray,
    distance: float,
    min_length: float,
    max_gap: float,
    changes: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the points of the segments along the lines, and the number of points of each segment.

    A stronger line that only crosses a segment must not take points from it. So a point that
    belongs to no segment of its line is moved to the next line that it is on, `changes` times.
    """
    labels = claim(rt, points, directions, theta, rho, distance, AIM)
    for _ in range(changes):
        chosen, _ = _segments(points, directions, labels, theta, min_length, max_gap)
        loose = labels < len(theta)
        loose[chosen] = False
        i = np.flatnonzero(loose)
        after = labels[i]
        labels[i] = claim(rt, points[i], directions[i], theta, rho, distance, AIM, after)
    return _segments(points, directions, labels, theta, min_length, max_gap)


def _segments(
    points: np.ndarray,
    directions: np.ndarray,
    labels: np.ndarray,
    theta: np.ndarray,
    min_length: float,
    max_gap: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the points of long and dense runs, and the number of points of each run."""
    normal = np.append(_codes(theta), 0)[labels]
    quarter = DIRECTIONS // 4  # a gradient is along the normal, or against it
    brighter = ((_codes(directions) - normal + quarter) & (DIRECTIONS - 1)) < 2 * quarter
    found = runs(points, labels, theta, max_gap, brighter.astype(np.intp))
    length = found.along[found.end - 1] - found.along[found.begin]
    number = found.end - found.begin
    kept = (length >= min_length) & (number >= DENSITY * length)
    begin, number = found.begin[kept], number[kept]
    first = np.cumsum(number) - number
    return found.order[np.repeat(begin - first, number) + np.arange(number.sum())], number


def fitted_segments(
    points: np.ndarray, directions: np.ndarray, number: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the segments fitted to groups of points, and their lines; `number` is per group."""
    if not len(number):
        return np.zeros((0, 4)), np.zeros(0), np.zeros(0)
    first = np.cumsum(number) - number
    place = points.astype(np.float64)
    theta, rho, _ = fit(place, np.ones(len(place)), first)
    c, s = np.cos(theta), np.sin(theta)
    along = place[:, 0] * np.repeat(c, number) - place[:, 1] * np.repeat(s, number)
    least, most = np.minimum.reduceat(along, first), np.maximum.reduceat(along, first)
    # Choose the first end so that the brighter side is always on the left.
    turned = np.cos(directions[first].astype(np.float64) - theta) < 0
    ends = [np.where(turned, a, b) for a, b in ((most, least), (least, most))]
    rows_columns = [(rho * s + t * c, rho * c - t * s) for t in ends]
    return np.stack([*rows_columns[0], *rows_columns[1]], axis=1), theta, rho


def fitted_lines(
    points: np.ndarray, labels: np.ndarray, lines: int, least: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return number of points, angle and distance of the lines with enough points."""
    number = np.bincount(labels, minlength=lines + 1)[:lines]
    number = np.where(number >= max(least, 2), number, 0)
    chosen = np.argsort(labels, kind="stable")
    chosen = chosen[np.append(number, 0)[labels[chosen]] > 0]
    number = number[number > 0]
    if not len(number):
        return number, np.zeros(0), np.zeros(0)
    first = np.cumsum(number) - number
    place = points[chosen].astype(np.float64)
    theta, rho, _ = fit(place, np.ones(len(place)), first)
    line = np.repeat(np.arange(len(number)), number)
    theta, rho, _ = fit(place, _weights(place, theta, rho, line, first, number), first)
    return number, theta, rho


def _weights(
    points: np.ndarray,
    theta: np.ndarray,
    rho: np.ndarray,
    line: np.ndarray,
    first: np.ndarray,
    number: np.ndarray,
) -> np.ndarray:
    """Return Tukey's weights of points on lines; the scale of a line is its median distance.

    Rounded corners, and specks that a line passes, would turn a line fitted by least squares alone.
    """
    away = np.abs(
        points[:, 1] * np.cos(theta)[line] + points[:, 0] * np.sin(theta)[line] - rho[line]
    )
    median = away[np.lexsort((away, line))][first + number // 2]
    share = away / np.maximum(_TUKEY * median, _LEAST_SCALE)[line]
    return (1 - share.clip(max=1) ** 2) ** 2


def fit(
    points: np.ndarray, weights: np.ndarray, first: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return angle, distance and root mean square distance of lines fitted to runs of points.

    A line goes through the centroid, along the major axis of the covariance.
    """

    def total(values: np.ndarray) -> np.ndarray:
        return np.add.reduceat(values, first)

    number = np.diff(np.append(first, len(points)))
    sums = total(weights)
    y, x = (total(weights * a) / sums for a in points.T)
    down, along = points[:, 0] - np.repeat(y, number), points[:, 1] - np.repeat(x, number)
    yy, xx, xy = (total(weights * a) for a in (down * down, along * along, down * along))
    # Rotating the normal by half a turn gives the same line.
    theta = 0.5 * np.arctan2(2 * xy, xx - yy) + math.pi / 2
    theta = np.where(theta >= math.pi / 2, theta - math.pi, theta)
    c, s = np.cos(theta), np.sin(theta)
    left = xx * c * c + 2 * xy * c * s + yy * s * s
    return theta, x * c + y * s, np.sqrt(np.maximum(left, 0) / sums)
