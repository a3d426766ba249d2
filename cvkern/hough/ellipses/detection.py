"""Ellipses in a photograph: votes of pairs of edge points, then a least-squares fit."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import (
    check_integer,
    check_number,
    check_photograph,
    check_positive,
    check_sides,
)
from cvkern._runtime import Runtime, runtime
from cvkern._stacks import one_by_one
from cvkern.hough.circles.detection import check_range, check_support, distinct, edge_lines
from cvkern.hough.ellipses.votes import between, paired
from cvkern.kernels.codes.hough import MAX_BINS

FINEST = 20  # pixels: a photograph is reduced until its smallest axis is less than twice this
TOLERANCE = 0.2  # radians: largest error of a gradient's direction, in the votes and in the fit
FINE = 2.0  # pixels: width of the bins of the minor axis
CANDIDATES = 64  # ellipses that are fitted
FIRST_BAND, LAST_BAND = 4.0, 1.5  # pixels: largest distance of a fit's points from the ellipse
FITS = 5
ARCS = 72  # arcs of a perimeter, each with its share of visible points


class Ellipses(NamedTuple):
    """Ellipses in order of decreasing support."""

    centers: Any
    """Row and column, in pixels with integer centres, (N, 2) float32."""
    axes: Any
    """Major and minor semi-axis in pixels, (N, 2) float32."""
    orientation: Any
    """Direction of the major axis, ``atan2(rows, columns)`` in (-pi / 2, pi / 2], (N,) float32."""
    support: Any
    """Share of the perimeter along which edge points were found, (N,) float32."""


def detect_ellipses(
    image: Any,
    axis_range: tuple[float, float],
    *,
    sigma: float = 2.0,
    low_threshold: float | None = None,
    high_threshold: float | None = None,
    min_support: float = 0.6,
    min_distance: float | None = None,
    max_points: int = 1500,
    batch_axis: int | None = None,
) -> Any:
    """Find the ellipses in a photograph.

    Two edge points whose gradients lie along the line between them are taken as the ends of a major
    axis. The points whose gradients fit vote for the minor axis, as in :func:`hough_ellipse`. The
    best ellipses are fitted to all edge points near them, with sub-pixel accuracy. Of ellipses
    whose centres are close, only the one with the largest support is kept.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C) with C in 3, 4, or a stack of them
        Any real dtype; colour as in :func:`canny`.
    axis_range : two floats
        Smallest minor and largest major semi-axis, in pixels; at least 3. If the smallest is 40 or
        more, the photograph is first reduced by an integer factor, so that it becomes less than
        40.
    sigma : float, default 2.0
        Standard deviation of the Gaussian that smooths before edge detection, in pixels of the
        reduced photograph.
    low_threshold, high_threshold : float, optional
        Thresholds of :func:`canny` on the reduced photograph. By default the quantiles 0.7 and 0.9
        of its gradients, but at least 2 % of the longest. If only one is given, the lower is half
        of the higher.
    min_support : float, default 0.6
        Smallest share of the perimeter that must be visible, in (0, 1].
    min_distance : float, optional
        Smallest distance between centres. By default the smallest semi-axis.
    max_points : int, default 1500
        If there are more edge points than this, only every second (third, ...) votes. The time for
        the votes grows with the square of this number, times the number of points along an ellipse.
    batch_axis : {0}, optional
        Axis of the images in a stack, (N, H, W) or (N, H, W, 3 or 4). The result is then a list
        with one result for each image, because their lengths differ.

    Returns
    -------
    Ellipses, or list of them
        Named tuple of `centers` (N, 2), `axes` (N, 2), `orientation` (N,) and `support` (N,),
        float32.

    Raises
    ------
    TypeError
        If `image` does not hold real numbers, or an option is not a number.
    ValueError
        If `image` is empty, of another shape, or longer than 65536 on a side; if `axis_range` is
        not two ascending numbers of at least 3, or its first is larger than half the shorter side;
        if `min_support` is not in (0, 1], `min_distance` negative, or `max_points` not in [3,
        16384]; and as in :func:`canny`.

    Notes
    -----
    Both ends of the major axis must be visible, because a pair of points there starts the search.
    Elsewhere, half of the ellipse may be hidden.

    References
    ----------
    .. [1] Y. Xie and Q. Ji, "A new efficient ellipse detection method", ICPR 2002.
    .. [2] R. Halir and J. Flusser, "Numerically stable direct least squares fitting of ellipses",
       WSCG 1998.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> y, x = np.mgrid[:80, :120]
    >>> disc = 200.0 * (np.hypot((y - 41) / 20, (x - 58) / 40) < 1)
    >>> found = cvkern.detect_ellipses(disc, (10, 50), high_threshold=80)
    >>> found.centers.round(), found.axes.round()
    (array([[41., 58.]], dtype=float32), array([[40., 20.]], dtype=float32))
    """
    if batch_axis is not None:
        return one_by_one(detect_ellipses, locals())
    image = check_photograph(image)
    sides = check_sides(image.shape[:2], "image")
    low, high = check_range(axis_range, min(sides), "axis_range")
    least = check_support(min_support)
    apart = low if min_distance is None else check_number(min_distance, "min_distance", low=0)
    most = check_integer(max_points, "max_points", 3, 2**14)
    rt = runtime(image)
    sigma = check_positive(sigma, "sigma")
    factor = max(1, int(low / FINEST))
    lines = edge_lines(rt, image, factor, sigma, low_threshold, high_threshold)
    shapes, support = np.empty((0, 5)), np.empty(0)
    if lines is not None:
        points = rt.to_numpy(lines)
        reach = low / factor, min(high / factor, math.hypot(*sides))
        exact = points.astype(np.float64)
        fits = [_fitted(exact, e) for e in _candidates(rt, points, reach, most, least)]
        shapes = np.array([shape for shape, _ in fits]).reshape(-1, 5)
        support = np.array([share for _, share in fits])
        center, axes, turned = np.split(shapes, (2, 4), axis=1)
        # The edge of a blurred shape lies sigma^2 / 2 times its curvature inside the true edge.
        axes = axes + sigma * sigma / 2 * axes / axes[:, ::-1] ** 2
        shapes = np.hstack((center * factor + (factor - 1) / 2, axes * factor, turned))
        kept = (support >= least) & (axes[:, 1] * factor >= low - 1)
        kept &= axes[:, 0] * factor <= high + 1
        shapes, support = shapes[kept], support[kept]
        best = distinct(shapes, support, apart)
        shapes, support = shapes[best], support[best]
    found = shapes[:, :2], shapes[:, 2:4], shapes[:, 4], support
    return Ellipses(*(rt.give(a.astype(np.float32)) for a in found))


def _candidates(
    rt: Runtime, points: np.ndarray, reach: tuple[float, float], most: int, least: float
) -> list[np.ndarray]:
    """Return row, column, semi-axes and orientation of the ellipses with the most votes."""
    step = -(-points.shape[1] // most)
    sample = np.ascontiguousarray(points[:, ::step])
    # A third of the points of the smallest ellipse whose visible share is just `least`.
    threshold = max(4, int(least * reach[0] * 2 * math.pi / step / 3))
    lengths, turn = (2 * reach[0], 2 * reach[1]), math.sin(TOLERANCE) ** 2
    accuracy = max(FINE, 2 * reach[1] / MAX_BINS)
    votes, pairs, minor = paired(rt, sample, threshold, lengths, reach, accuracy, turn)
    center, axes, turned = between(sample[:2, pairs].astype(np.float64), minor)
    order = np.argsort(-votes / _perimeter(axes), kind="stable")[: 64 * CANDIDATES]
    shapes = np.column_stack((center, axes, turned))[order]
    chosen = []
    # Each round adds one, up to `CANDIDATES`.
    while len(shapes) and len(chosen) < CANDIDATES:
        best = shapes[0]
        chosen.append(best)
        near = np.abs(shapes[:, :4] - best[:4]).max(axis=1) < 0.2 * best[3] + 1
        shapes = shapes[~near]
    return chosen


def _perimeter(axes: np.ndarray) -> np.ndarray:
    """Return the perimeters of ellipses with these semi-axes, (N, 2), by Ramanujan's formula."""
    a, b = axes.T
    return math.pi * (3 * (a + b) - np.sqrt((3 * a + b) * (a + 3 * b)))


def _fitted(points: np.ndarray, shape: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the least-squares ellipse near `shape`, and its visible share."""
    for step in range(FITS):
        band = max(LAST_BAND, FIRST_BAND - step)
        near, _ = _near(points, shape, band)
        if near.sum() < 6:
            return shape, 0.0
        better = _direct_fit(points[0, near], points[1, near])
        if better is None:
            return shape, 0.0
        shape = better
    near, angle = _near(points, shape, LAST_BAND)
    # Points that each arc of a whole ellipse has: one per row or column of pixels that it crosses.
    edges = np.linspace(-math.pi, math.pi, ARCS + 1)
    u, v = shape[2] * np.cos(edges), shape[3] * np.sin(edges)
    sine, cosine = math.sin(shape[4]), math.cos(shape[4])
    rows, columns = u * sine + v * cosine, u * cosine - v * sine
    whole = np.maximum(np.abs(np.diff(rows)), np.abs(np.diff(columns)))
    seen, _ = np.histogram(angle[near], edges)
    return shape, float(np.minimum(seen, whole).sum() / whole.sum())


def _near(points: np.ndarray, shape: np.ndarray, band: float) -> tuple[np.ndarray, np.ndarray]:
    """Tell which points lie near an ellipse with a gradient normal to it, and at which angle."""
    row, column, major, minor, turn = shape
    sine, cosine = math.sin(turn), math.cos(turn)
    y, x = points[0] - row, points[1] - column
    u, v = x * cosine + y * sine, y * cosine - x * sine
    normal = u / major**2, v / minor**2
    steep = np.hypot(*normal)
    # With f = (u / a)^2 + (v / b)^2 - 1, the distance is f / |grad f| to first order.
    away = np.abs(u * normal[0] + v * normal[1] - 1) <= 2 * band * steep
    along = points[3] * cosine + points[2] * sine, points[2] * cosine - points[3] * sine
    cross = along[0] * normal[1] - along[1] * normal[0]
    return away & (np.abs(cross) <= math.sin(TOLERANCE) * steep), np.arctan2(v / minor, u / major)


def _direct_fit(row: np.ndarray, column: np.ndarray) -> np.ndarray | None:
    """Return the ellipse of least algebraic distance (Halir and Flusser 1998), or None."""
    middle, scale = np.array([row.mean(), column.mean()]), max(row.std(), column.std(), 1e-9)
    y, x = (row - middle[0]) / scale, (column - middle[1]) / scale
    squares, rest = np.stack((x * x, x * y, y * y), 1), np.stack((x, y, np.ones_like(x)), 1)
    try:
        to_rest = -np.linalg.solve(rest.T @ rest, rest.T @ squares)
        scatter = squares.T @ squares + squares.T @ rest @ to_rest
        # Multiply by the inverse of the matrix of the constraint 4 a c - b^2 = 1 (an ellipse).
        _, vectors = np.linalg.eig(np.stack((scatter[2] / 2, -scatter[1], scatter[0] / 2)))
    except np.linalg.LinAlgError:
        return None
    vectors = np.real(vectors)
    ellipse = 4 * vectors[0] * vectors[2] - vectors[1] ** 2 > 0
    if not ellipse.any():
        return None
    a, b, c = vectors[:, np.argmax(ellipse)]
    d, e, f = to_rest @ (a, b, c)
    form = np.array([[2 * a, b], [b, 2 * c]])
    center = np.linalg.solve(form, (-d, -e))
    values, directions = np.linalg.eigh(form / 2)
    squared = -(f + 0.5 * (d * center[0] + e * center[1])) / values
    if not (squared > 0).all():
        return None
    major = int(np.argmax(squared))
    turn = math.atan2(directions[1, major], directions[0, major])
    turn -= math.pi * (turn > math.pi / 2) - math.pi * (turn <= -math.pi / 2)
    axes = np.sqrt(np.sort(squared)[::-1]) * scale
    return np.array([*(center[::-1] * scale + middle), *axes, turn])
