"""The points that support a line, their positions along it, and the line that fits them best."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import check_accumulator
from cvkern._runtime import Runtime
from cvkern.hough.lines._tables import (
    SUBPIXEL,
    direction_windows,
    kernel_tables,
    line_tables,
    reach,
    subpixel_points,
)
from cvkern.hough.lines.votes import suggest_line_bins
from cvkern.kernels.codes.hough import DIRECTION_FACTOR, DIRECTIONS, LineWindows, most_peaks

AIM = math.pi / 8  # radians: largest angle between a gradient and the normal of its line
_AIM_OF_VOTES = math.radians(3)  # the same for votes, where more would cost time and add clutter
_LOCALISATION = 0.25  # pixels: standard deviation of sub-pixel edges in photographs
_LENGTH = 320  # pixels: lines up to this length fall into one bin; longer ones into several
_APART = 3, 3  # bins of rho and theta between the peaks of one round
FITS = 2  # fits of a line; each uses the points that are on the line of the previous fit
_TUKEY = 4.685 / 0.6745  # farthest point that counts, in medians: 95 % efficient for normal errors
_LEAST_SCALE = 0.1  # pixels: the farthest point that counts is at least this far away


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
    found = subpixel_points(rt, points, size)
    return vote_listed(rt, found.points, found.starts, rt.adopt(directions), size, least)


def vote_listed(
    rt: Runtime, points: Any, starts: Any, directions: Any, size: tuple[int, int], least: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the same of kernel arrays: points in fixed point, their number, and directions."""
    step, theta = suggest_line_bins(size, _LOCALISATION, length=_LENGTH)
    distances = reach(size, step)
    shape = (2 * distances + 1, len(theta))
    check_accumulator(shape, "votes")
    angles = theta.tobytes()
    tables = kernel_tables(rt, line_tables(angles, step, size, parts=SUBPIXEL))
    windows = direction_windows(angles, _AIM_OF_VOTES)
    allowed = LineWindows(directions, *map(rt.constant, windows))
    keys = rt.scratch("detect.keys", (most_peaks(shape, _APART),), np.int64)
    total = rt.scratch("detect.total", (1,), np.int32)
    limit = math.ceil(least) - 1
    rt.hough.lines.peaks.find_lines(
        points, starts, allowed, tables, shape, limit, _APART, keys, total
    )
    number = int(rt.to_numpy(total)[0])
    bins = np.sort(rt.to_numpy(keys[: max(number, 1)])[:number]) & 0xFFFFFFFF
    row, column = np.divmod(bins, len(theta))
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
        rt.adopt(codes_of(directions), np.int32),
        rt.adopt(past, np.int32),
        rt.adopt(np.stack((np.cos(theta), np.sin(theta), rho))),
        rt.adopt(codes_of(theta), np.int32),
        float(np.float32(distance)),
        math.floor(min(tolerance, math.pi) * DIRECTION_FACTOR),
        labels,
    )
    return rt.to_numpy(labels).copy()


def codes_of(angles: np.ndarray) -> np.ndarray:
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
    theta = normal_of(yy, xx, xy)
    c, s = np.cos(theta), np.sin(theta)
    left = xx * c * c + 2 * xy * c * s + yy * s * s
    return theta, x * c + y * s, np.sqrt(np.maximum(left, 0) / sums)


def normal_of(yy: np.ndarray, xx: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """Return the angles of the normals of the major axes of covariances, in [-pi/2, pi/2)."""
    # Rotating the normal by half a turn gives the same line.
    theta = 0.5 * np.arctan2(2 * xy, xx - yy) + math.pi / 2
    return np.where(theta >= math.pi / 2, theta - math.pi, theta)
