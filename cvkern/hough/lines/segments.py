"""Line segments: the supported parts of voted lines, and lines and segments of photographs."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import (
    as_numbers,
    check_beside,
    check_image,
    check_number,
    check_photograph,
    check_positive,
    check_sides,
)
from cvkern._runtime import Runtime, runtime
from cvkern.edges.masks import photograph_options
from cvkern.edges.quantiles import LINE_SHARES
from cvkern.edges.subpixel import SubpixelEdges, locate_edges
from cvkern.filters.gradients import without_channels
from cvkern.hough._points import mask_points
from cvkern.hough.lines._support import (
    AIM,
    FITS,
    claim,
    fit,
    fitted_lines,
    runs,
    vote,
)
from cvkern.hough.lines._tables import check_listed, values_at
from cvkern.hough.lines.peaks import HoughLinePeaks
from cvkern.hough.lines.runs import Rule, find_segments
from cvkern.hough.lines.votes import check_points


class LineFit(NamedTuple):
    """A line ``x cos(theta) + y sin(theta) = rho``."""

    theta: float
    """The angle of the normal, radians in [-pi/2, pi/2)."""
    rho: float
    """The distance from pixel (0, 0), pixels."""
    rms: float
    """The root mean square distance of the points from the line, pixels."""


def hough_line_segments(
    mask: Any,
    theta: Any,
    rho: Any,
    *,
    min_length: float = 10.0,
    max_gap: float = 3.0,
    distance: float = 1.0,
    orientation: Any = None,
    orientation_tolerance: float = AIM,
) -> Any:
    """Find the parts of lines that are covered by set pixels.

    Parameters
    ----------
    mask : array of shape (H, W)
        Nonzero pixels count; bool or any real dtype.
    theta, rho : array of shape (K,)
        The lines, strongest first, as :func:`hough_line_peaks` gives them.
    min_length : float, default 10.0
        Smallest length of a segment, pixels.
    max_gap : float, default 3.0
        Largest gap between neighbouring pixels of a segment, pixels.
    distance : float, default 1.0
        Largest distance of a pixel that is on a line. A pixel belongs to the first line that it is
        on.
    orientation : array of shape (H, W), optional
        Direction of the gradient, radians. Then a pixel is on a line only if its gradient is
        within `orientation_tolerance` of the line's normal.
    orientation_tolerance : float, default pi / 8
        Radians.

    Returns
    -------
    array of shape (N, 4), float32
        Row and column of one end, then of the other, both on the line. Segments are in the order
        of the lines, then in the order along each line.

    Raises
    ------
    TypeError
        If an array does not hold real numbers.
    ValueError
        If `mask` is empty, not 2-D or has a side longer than 65536; `theta` and `rho` are not
        finite lists of equal length; `orientation` has another shape than `mask` or is NaN at a
        set pixel; or a number is negative.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> mask = np.zeros((40, 60), bool)
    >>> mask[10, 5:25] = mask[10, 40:55] = True
    >>> cvkern.hough_line_segments(mask, [np.pi / 2], [10]).round(2)
    array([[10., 54., 10., 40.],
           [10., 24., 10.,  5.]], dtype=float32)
    """
    mask = check_image(mask, name="mask")
    check_sides(mask.shape, "mask")
    theta, rho = _check_lines(theta, rho)
    min_length = check_number(min_length, "min_length", low=0)
    max_gap = check_number(max_gap, "max_gap", low=0)
    distance = check_number(distance, "distance", low=0)
    tolerance = check_number(orientation_tolerance, "orientation_tolerance", low=0)
    orientation = check_beside(orientation, tuple(mask.shape), "orientation")
    rt = runtime(mask, orientation)
    found = mask_points(rt, mask, "segments")
    number = int(rt.to_numpy(found.starts)[-1])
    points = rt.to_numpy(found.points[: max(number, 1)])[:number].astype(np.float32)
    directions = np.zeros(number, np.float32)
    if orientation is None:
        tolerance = math.pi
    else:
        listed = values_at(rt, found, orientation, "orientation")
        directions = check_listed(rt, found, listed, "orientation", -math.inf)
    labels = claim(rt, points, directions, theta, rho, distance, tolerance)
    parts = runs(points, labels, theta, max_gap)
    first, last = (
        end.reduceat(parts.along, parts.begin) if len(parts.begin) else np.zeros(0)
        for end in (np.minimum, np.maximum)
    )
    long = last - first >= min_length
    c, s, r = np.cos(theta)[parts.line], np.sin(theta)[parts.line], rho[parts.line]
    ends = [(r * s + t * c, r * c - t * s) for t in (first, last)]
    segments = np.stack([*ends[0], *ends[1]], axis=1)[long]
    return rt.give(segments.astype(np.float32))


def fit_line(points: Any, weights: Any = None) -> LineFit:
    """Fit a line to points by total least squares.

    Parameters
    ----------
    points : array of shape (N, 2)
        Row and column.
    weights : array of shape (N,), optional
        Not negative; by default all equal.

    Returns
    -------
    LineFit
        Named tuple of `theta`, `rho` and `rms`. The line has the smallest weighted sum of squared
        distances of the points.

    Raises
    ------
    TypeError
        If an array does not hold real numbers.
    ValueError
        If `points` does not have shape (N, 2), or `weights` shape (N,); if a number is not finite
        or a weight negative; or if all points with a positive weight are equal.

    Examples
    --------
    >>> import cvkern
    >>> fit = cvkern.fit_line([[0, 3], [1, 3], [5, 3]])
    >>> fit.theta, fit.rho, fit.rms
    (0.0, 3.0, 0.0)
    """
    points = check_points(points)
    weights = check_beside(weights, (len(points),), "weights")
    rt = runtime(points, weights)
    place, weight = (_on_host(rt, a, np.float64) for a in (points, weights))
    if not np.isfinite(place).all():
        raise ValueError("points must be finite, got some that are not")
    if weights is None:
        weight = np.ones(len(place))
    elif not (np.isfinite(weight) & (weight >= 0)).all():
        wrong = weight[~(np.isfinite(weight) & (weight >= 0))]
        raise ValueError(f"weights must be >= 0 and finite, got {wrong[0]:g}")
    place, weight = place[weight > 0], weight[weight > 0]
    if not len(place) or (place == place[0]).all():
        raise ValueError("points must be two or more, in different places, got fewer")
    theta, rho, rms = fit(place, weight, np.zeros(1, np.intp))
    return LineFit(float(theta[0]), float(rho[0]), float(rms[0]))


def detect_lines(
    image: Any,
    sigma: float = 1.0,
    low_threshold: float | None = None,
    high_threshold: float | None = None,
    *,
    use_quantiles: bool = False,
    min_votes: float | None = None,
    distance: float = 1.0,
    batch_axis: int | None = None,
) -> Any:
    """Find the straight lines of a photograph.

    Sub-pixel edges vote for lines across their gradients. Each peak is fitted robustly to the edges
    near it, and these edges are removed. The others vote again, until no line has enough votes.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C) with C in 3, 4, or a stack of them
        Any real dtype; colour as in :func:`canny`.
    sigma : float, default 1.0
        Standard deviation of the Gaussian under the edges, pixels.
    low_threshold, high_threshold : float, optional
        Thresholds of the edges, as in :func:`canny`. By default the quantiles 0.5 and 0.7 of the
        image's gradients, but at least 2 % of the longest. If only one is given, the lower is half
        of the higher.
    use_quantiles : bool, default False
        As in :func:`canny`.
    min_votes : float, optional
        Smallest number of edge points of a line; by default a tenth of the image's diagonal.
    distance : float, default 1.0
        Largest distance of an edge point that is on a line, pixels.
    batch_axis : {0}, optional
        Axis of the images in a stack, (N, H, W) or (N, H, W, 3 or 4). The result is then a list
        with one result for each image, because their lengths differ.

    Returns
    -------
    HoughLinePeaks, or list of them
        Named tuple of `votes` (K,) int32, the number of edge points on each line, most first, and
        of `theta` and `rho` (K,), the fitted lines, as NumPy arrays.

    Raises
    ------
    TypeError
        If `image` does not hold real numbers.
    ValueError
        As :func:`canny`; or if a side of the image is longer than 65536, or `min_votes` or
        `distance` is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> step = np.zeros((60, 80), np.uint8)
    >>> step[:, 30:] = 200
    >>> votes, theta, rho = cvkern.detect_lines(step)
    >>> votes.tolist(), abs(theta).round(3).tolist(), rho.round(2).tolist()
    ([60], [0.0], [29.5])
    """
    image = check_photograph(image, batch_axis=batch_axis)
    size = check_sides(without_channels(image, batch_axis)[-2:], "image")
    distance = check_positive(distance, "distance")
    least = 0.1 * math.hypot(*size) if min_votes is None else check_positive(min_votes, "min_votes")
    options = photograph_options(
        image, sigma, low_threshold, high_threshold, use_quantiles, automatic=LINE_SHARES
    )
    rt = runtime(image)
    found = locate_edges(rt, image, options._replace(batch_axis=batch_axis))
    results = [_lines_of(rt, edges, size, least, distance) for edges in found]
    return results[0] if batch_axis is None else results


def _lines_of(
    rt: Runtime, edges: SubpixelEdges, size: tuple[int, int], least: float, distance: float
) -> HoughLinePeaks:
    points, directions = (_on_host(rt, a, np.float32) for a in edges[:2])
    lines = [np.zeros((0, 3))]
    for _ in range(len(points) + 1):  # each round but the last removes at least one point
        theta, rho = vote(rt, points, directions, size, least)
        number = np.zeros(0)
        for _ in range(FITS):
            labels = claim(rt, points, directions, theta, rho, distance, AIM)
            number, theta, rho = fitted_lines(points, labels, len(theta), least)
        if not len(number):
            break
        # Points within twice the distance belong to the same edge, so they make no other line.
        taken = claim(rt, points, directions, theta, rho, 2 * distance, AIM) < len(theta)
        if not taken.any():  # the fitted line is away from all points
            break
        lines.append(np.stack([number, theta, rho], axis=1))
        points, directions = points[~taken], directions[~taken]
    votes, theta, rho = np.concatenate(lines).T
    order = np.argsort(-votes, kind="stable")
    return HoughLinePeaks(rt.give(votes[order].astype(np.int32)), theta[order], rho[order])


def detect_segments(
    image: Any,
    sigma: float = 1.0,
    low_threshold: float | None = None,
    high_threshold: float | None = None,
    *,
    use_quantiles: bool = False,
    min_length: float = 10.0,
    max_gap: float = 3.0,
    distance: float = 1.0,
    batch_axis: int | None = None,
) -> Any:
    """Find the straight segments of a photograph's edges.

    Sub-pixel edges vote for lines across their gradients. Along the line of each peak, a segment is
    fitted to edges that follow one another without a gap, and these edges are removed. The others
    vote again, until a round finds few segments.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C) with C in 3, 4, or a stack of them
        Any real dtype; colour as in :func:`canny`.
    sigma : float, default 1.0
        Standard deviation of the Gaussian under the edges, pixels.
    low_threshold, high_threshold : float, optional
        Thresholds of the edges, as in :func:`canny`. By default the quantiles 0.5 and 0.7 of the
        image's gradients, but at least 2 % of the longest. If only one is given, the lower is half
        of the higher.
    use_quantiles : bool, default False
        As in :func:`canny`.
    min_length : float, default 10.0
        Smallest length of a segment, pixels.
    max_gap : float, default 3.0
        Largest gap between neighbouring edge points of a segment, pixels.
    distance : float, default 1.0
        Largest distance of an edge point from the line of a peak, pixels.
    batch_axis : {0}, optional
        Axis of the images in a stack, (N, H, W) or (N, H, W, 3 or 4). The result is then a list
        with one result for each image, because their lengths differ.

    Returns
    -------
    array of shape (N, 4), float32, or list of them
        Row and column of one end, then of the other; the longest segment comes first. Seen from
        the first end towards the second, the brighter side is on the left.

    Raises
    ------
    TypeError
        If `image` does not hold real numbers.
    ValueError
        As :func:`canny`; or if a side of the image is longer than 65536, `max_gap` is negative,
        or `min_length` or `distance` is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> step = np.zeros((60, 80), np.uint8)
    >>> step[:, 30:] = 200
    >>> cvkern.detect_segments(step).round(1)
    array([[ 0. , 29.5, 59. , 29.5]], dtype=float32)
    """
    image = check_photograph(image, batch_axis=batch_axis)
    size = check_sides(without_channels(image, batch_axis)[-2:], "image")
    min_length = check_positive(min_length, "min_length")
    max_gap = check_number(max_gap, "max_gap", low=0)
    distance = check_positive(distance, "distance")
    options = photograph_options(
        image, sigma, low_threshold, high_threshold, use_quantiles, automatic=LINE_SHARES
    )
    rt = runtime(image)
    rule = Rule(min_length, max_gap, distance)
    results = []
    for edges in locate_edges(rt, image, options._replace(batch_axis=batch_axis)):
        found = np.zeros((0, 4))
        if len(edges.orientation):
            given = rt.adopt(edges.points), rt.adopt(edges.orientation)
            found = find_segments(rt, *given, size, rule)
        length = np.hypot(found[:, 2] - found[:, 0], found[:, 3] - found[:, 1])
        results.append(rt.give(found[np.argsort(-length, kind="stable")].astype(np.float32)))
    return results[0] if batch_axis is None else results


def _on_host(rt: Runtime, array: Any, dtype: Any) -> np.ndarray:
    """Return an array of any library on the host."""
    if array is None or 0 in array.shape:
        return np.zeros((0, *(() if array is None else array.shape[1:])), dtype)
    return rt.to_numpy(rt.adopt(array, dtype))


def _check_lines(theta: Any, rho: Any) -> tuple[np.ndarray, np.ndarray]:
    lines = [as_numbers(theta, "theta"), as_numbers(rho, "rho")]
    if lines[0].ndim != 1 or lines[0].shape != lines[1].shape:
        raise ValueError(
            f"theta and rho must be lists of one length, got shapes {lines[0].shape} and "
            f"{lines[1].shape}"
        )
    for name, values in zip(("theta", "rho"), lines, strict=True):
        if not np.isfinite(values).all():
            raise ValueError(f"{name} must be finite, got {values[~np.isfinite(values)][0]}")
    return lines[0], lines[1]
