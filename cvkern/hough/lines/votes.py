"""Straight lines by voting: the Hough transform in (rho, theta) and in (m, c)."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import (
    MAX_ELEMENTS,
    as_numbers,
    check_accumulator,
    check_beside,
    check_image,
    check_number,
    check_positive,
    check_sides,
)
from cvkern._runtime import runtime
from cvkern.hough._points import check_masks, mask_points
from cvkern.hough.lines._tables import (
    SUBPIXEL,
    cast_votes,
    crossing,
    direction_windows,
    fixed_tables,
    line_tables,
    reach,
    subpixel_points,
)

_DEGREES = np.linspace(-math.pi / 2, math.pi / 2, 180, endpoint=False)
_STANDS_OUT = 2.8  # best width of a bin in standard deviations of the points: 2 sqrt(2) 0.99


class HoughLine(NamedTuple):
    """An accumulator of lines and the meaning of its axes."""

    votes: Any
    """The votes for each distance and angle, (R, T) int32, or (N, R, T) of a stack."""
    theta: np.ndarray
    """The angle of a line's normal from the x axis towards the y axis, radians, (T,) float64."""
    rho: np.ndarray
    """The distance of a line from pixel (0, 0) along the normal, pixels, (R,) float64."""


class HoughLineSlope(NamedTuple):
    """Two accumulators of lines, one for each chart, and the meaning of their axes."""

    votes: Any
    """The votes for lines ``y = m x + c``, (C, M) int32."""
    swapped: Any
    """The votes for lines ``x = m y + c``, (C, M) int32."""
    slopes: np.ndarray
    """The slope m of each column, (M,) float64."""
    intercepts: np.ndarray
    """The intercept c of each row, pixels, (C,) float64."""


class LineBins(NamedTuple):
    """Bins of an accumulator of lines, as :func:`hough_line` takes them."""

    rho_step: float
    """Distance between neighbouring bins, pixels."""
    theta: np.ndarray
    """The angles over half a turn, radians, (T,) float64."""


def hough_line(
    mask: Any = None,
    theta: Any = None,
    *,
    points: Any = None,
    shape: tuple[int, int] | None = None,
    rho_step: float = 1.0,
    orientation: Any = None,
    orientation_tolerance: float = 0.0,
    weights: Any = None,
    batch_axis: int | None = None,
) -> HoughLine:
    """Count the votes of the points of an image for the lines through them.

    A line is ``x cos(theta) + y sin(theta) = rho``. Each point votes once for every angle theta,
    for the nearest bin of rho. A line is present where many votes meet.

    Parameters
    ----------
    mask : array of shape (H, W), or a stack of them
        The points are the pixels that are not zero; bool or any real dtype.
    theta : array of shape (T,), optional
        Angles, radians. By default 180 angles, one degree apart, beginning at -pi/2.
    points : array of shape (N, 2), optional
        Row and column of points, in place of `mask`; rounded to 1/4096 of a pixel.
    shape : (int, int), optional
        Height and width of the image that contains `points`; required with them.
    rho_step : float, default 1.0
        Distance between neighbouring bins of rho, pixels.
    orientation : array of the shape of `mask`, or (N,), optional
        Direction of the gradient at the points, radians, as :func:`gradient` and
        :func:`subpixel_edges` return it. A point then votes only for lines across its gradient:
        for `theta` within `orientation_tolerance` of it, or for the nearest `theta` if there is
        none. `theta` must ascend, and span less than half a turn.
    orientation_tolerance : float, default 0.0
        Radians.
    weights : array of the shape of `mask`, or (N,), optional
        Votes are sums of ``round(256 weight)`` over the points, instead of their number.
    batch_axis : {0}, optional
        Axis of the masks in a stack, (N, H, W); on a GPU all vote in one launch. Not for `points`.

    Returns
    -------
    HoughLine
        Named tuple of `votes` (R, T) int32, or (N, R, T) of a stack, `theta` (T,) and `rho` (R,).
        The last two are always NumPy arrays.

    Raises
    ------
    TypeError
        If an array does not hold real numbers.
    ValueError
        If not exactly one of `mask` and `points` is given, or `points` without `shape`; an array
        is empty or of the wrong shape, or a side of the image is longer than 65536; points are
        outside the image; `theta` is not finite, or not as `orientation` requires; `rho_step` is
        not positive; `orientation_tolerance` is negative; `orientation` is NaN or a weight is
        negative at a point; the votes could exceed int32, or would take too much memory.

    Notes
    -----
    With ``rho_step=1`` the angles, distances and votes are those of
    :func:`skimage.transform.hough_line`, except for ties. Rho is computed in fixed point, with an
    error below ``(H + W) 2^-32`` pixels, which is less than 1e-5 up to 21000 x 21000; ties go to
    the larger bin. So votes are the same on every device and kernel set. Directions are first
    rounded to the nearest of 16384 over the full turn.

    References
    ----------
    .. [1] R. O. Duda and P. E. Hart, "Use of the Hough transformation to detect lines and curves
       in pictures", Communications of the ACM 15(1), 1972.
    .. [2] F. O'Gorman and M. B. Clowes, "Finding picture edges through collinearity of feature
       points", IEEE Transactions on Computers C-25(4), 1976 (votes along the gradient).

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> mask = np.zeros((60, 80), bool)
    >>> mask[:, 12] = True
    >>> votes, theta, rho = cvkern.hough_line(mask)
    >>> r, t = np.unravel_index(votes.argmax(), votes.shape)
    >>> int(votes.max()), float(theta[t]), float(rho[r])
    (60, 0.0, 12.0)
    """
    if (mask is None) == (points is None):
        raise ValueError(
            f"mask or points must be given, got {'neither' if mask is None else 'both'}"
        )
    if (points is None) != (shape is None):
        raise ValueError(f"shape must be given with points and only then, got {shape}")
    angles = check_angles(theta)
    step = check_positive(rho_step, "rho_step")
    tolerance = check_number(orientation_tolerance, "orientation_tolerance", low=0)
    if points is None:
        mask, size = check_masks(mask, batch_axis)
    else:
        if batch_axis is not None:
            raise ValueError(f"batch_axis must be None with points, got {batch_axis!r}")
        points = check_points(points)
        size = check_sides(shape, "shape")
    expected = tuple(mask.shape) if points is None else (len(points),)
    orientation = check_beside(orientation, expected, "orientation")
    weights = check_beside(weights, expected, "weights")
    distances = reach(size, step)
    bins = 2 * distances + 1
    shape_of_votes = (*expected[: len(expected) - 2], bins, len(angles))
    check_accumulator(shape_of_votes, "votes")
    windows = None
    if orientation is not None:
        windows = direction_windows(angles.tobytes(), tolerance)
    rt = runtime(mask, points, orientation, weights)
    if points is None:
        found = mask_points(rt, mask, "hough_line")
        tables = line_tables(angles.tobytes(), step, size, 1)
    else:
        found = subpixel_points(rt, points, size)
        tables = line_tables(angles.tobytes(), step, size, SUBPIXEL)
    votes = rt.empty(shape_of_votes, np.int32)
    view = rt.adopt(votes, np.int32)
    cast_votes(rt, found, tables, windows, orientation, weights, crossing(size, step), view)
    rho = step * np.arange(-distances, distances + 1.0)
    return HoughLine(rt.release(votes), angles, rho)


def hough_line_slope(mask: Any, slopes: Any = None, intercepts: Any = None) -> HoughLineSlope:
    """Count the votes of a mask's set pixels for lines in slope and intercept, as Hough did.

    Parameters
    ----------
    mask : array of shape (H, W)
        The points are the pixels that are not zero; bool or any real dtype.
    slopes : array of shape (M,), optional
        Slopes m in [-1, 1]; by default 181, evenly spaced.
    intercepts : array of shape (C,), optional
        Intercepts c, evenly spaced and ascending, pixels. By default all integers that points of
        the image can vote for.

    Returns
    -------
    HoughLineSlope
        Named tuple of `votes` and `swapped`, each (C, M) int32, `slopes` and `intercepts`.

    Raises
    ------
    TypeError
        If `mask` does not hold real numbers.
    ValueError
        If `mask` is empty, not 2-D or has a side longer than 65536; if `slopes` is not a list of
        numbers in [-1, 1]; if `intercepts` are fewer than two, not evenly spaced or not ascending;
        or if the votes would take too much memory.

    Notes
    -----
    A vertical line has no finite slope. So there are two charts: ``y = m x + c`` with ``|m| <= 1``
    for lines nearer to the x axis, and the same with the axes swapped for the others. The
    disadvantages of these parameters led to (rho, theta), as in :func:`hough_line` (Duda and Hart
    1972):

    - The intercepts range over ``W + H`` or more, although at each slope most of them belong to no
      line through the image. Rho needs only half the image's diagonal on each side of its centre.
    - Equal steps of slope are unequal steps of angle, ``dtheta = dm / (1 + m^2)``: twice as wide at
      ``m = 0`` as at ``m = 1``. Equal steps of c are unequal steps of distance,
      ``drho = dc / sqrt(1 + m^2)``. So the number of votes of a line depends on its angle.
    - Lines with ``|m| = 1`` are in both charts, so two peaks there must be merged.

    Bins are computed in fixed point, as in :func:`hough_line`; ties go to the larger intercept.

    References
    ----------
    .. [1] P. V. C. Hough, "Method and means for recognizing complex patterns", US patent
       3 069 654, 1962.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> mask = np.zeros((20, 30), bool)
    >>> mask[7, :] = True
    >>> mask[:, 12] = True
    >>> h = cvkern.hough_line_slope(mask, slopes=[-0.5, 0, 0.5])
    >>> int(h.votes[h.intercepts == 7, 1][0]), int(h.swapped[h.intercepts == 12, 1][0])
    (30, 20)
    """
    mask = check_image(mask, name="mask")
    height, width = size = check_sides(mask.shape, "mask")
    m = _check_slopes(slopes)
    # The range of c in both charts: from m = 1 at the end of an axis to m = -1 at the far corner.
    least, most = 1 - max(size), height + width - 2
    c = np.arange(least, most + 1.0) if intercepts is None else _check_intercepts(intercepts)
    step = float(c[-1] - c[0]) / (len(c) - 1) if len(c) > 1 else 1.0
    # The kernels check no bounds, so the accumulator has every bin that can get a vote.
    first = min(0, math.floor((least - c[0]) / step) - 1)
    last = max(len(c), math.ceil((most - c[0]) / step) + 2)
    check_accumulator((last - first, len(m)), "votes")
    rt = runtime(mask)
    found = mask_points(rt, mask, "hough_line")
    across, along = -m / step, np.full(len(m), 1 / step)
    results = []
    for cosine, sine in ((across, along), (along, across)):
        tables = fixed_tables(cosine, sine, -c[0] / step - first, size)
        votes = rt.empty((last - first, len(m)), np.int32)
        cast_votes(rt, found, tables, None, None, None, 0, rt.adopt(votes, np.int32))
        results.append(rt.release(votes)[-first : len(c) - first])
    votes, swapped = results
    return HoughLineSlope(votes, swapped, m, c)


def suggest_line_bins(
    shape: tuple[int, int], localisation: float = 0.3, *, length: float | None = None
) -> LineBins:
    """Choose the bins of an accumulator for the size of the image and the error of its points.

    Parameters
    ----------
    shape : (int, int)
        Height and width of the image.
    localisation : float, default 0.3
        Standard deviation of the points from their line, pixels. Pixels of a thin edge have
        ``1 / sqrt(12) = 0.3`` from rounding alone; sub-pixel edges of a good photograph have 0.05
        to 0.1.
    length : float, optional
        Length of the longest lines whose votes must fall into one bin, pixels. By default the
        image's diagonal.

    Returns
    -------
    LineBins
        Named tuple of `rho_step` and `theta`, for :func:`hough_line`.

    Raises
    ------
    TypeError
        If an argument is not a number.
    ValueError
        If a side of the image is not in [1, 65536], or `localisation` or `length` is not positive.

    Notes
    -----
    Let the points deviate from their line by a normal error with standard deviation s. A bin of
    width w, centred on the line, gets the share ``erf(a)`` of the line's votes, where
    ``a = w / (2 sqrt(2) s)``. Chance votes grow with w, so their fluctuation grows with
    ``sqrt(w)``. The peak is clearest where ``erf(a) / sqrt(a)`` is largest: at ``a = 0.99``, which
    means ``w = 2.8 s`` and 84 % of the votes.

    Let the angles be d apart. The angle of a line is then at most ``d / 2`` from the nearest one,
    and the ends of a line of length L deviate by at most ``L d / 4``. They stay within the bin if
    this is at most ``w / 2``, so ``d = 2 w / L``.

    Examples
    --------
    >>> import cvkern
    >>> rho_step, theta = cvkern.suggest_line_bins((480, 640))
    >>> round(rho_step, 2), len(theta)
    (0.84, 1496)
    """
    size = check_sides(shape, "shape")
    width = _STANDS_OUT * check_positive(localisation, "localisation")
    longest = math.hypot(*size) if length is None else check_positive(length, "length")
    wanted = math.pi * longest / (2 * width)
    if wanted > MAX_ELEMENTS:
        raise ValueError(
            f"length must ask for at most {MAX_ELEMENTS} angles, got {longest:g} pixels for a "
            f"localisation of {localisation:g}"
        )
    number = max(2, math.ceil(wanted))
    return LineBins(width, np.linspace(-math.pi / 2, math.pi / 2, number, endpoint=False))


def _check_slopes(slopes: Any) -> np.ndarray:
    if slopes is None:
        return np.linspace(-1, 1, 181)
    m = as_numbers(slopes, "slopes")
    if m.ndim != 1 or not m.size or not (np.abs(m) <= 1).all():
        raise ValueError(
            f"slopes must be a list of numbers in [-1, 1], got shape {m.shape} with "
            f"{m.min(initial=math.inf):g} to {m.max(initial=-math.inf):g}"
        )
    return m


def _check_intercepts(intercepts: Any) -> np.ndarray:
    c = as_numbers(intercepts, "intercepts")
    steps = np.diff(c) if c.ndim == 1 else np.zeros(0)
    even = np.isfinite(steps).all() and len(steps) and steps[0] > 0
    if not even or not np.allclose(steps, steps[0], rtol=1e-6, atol=0):
        raise ValueError(
            f"intercepts must be two or more, evenly spaced and ascending, got {intercepts!r}"
        )
    return c


def check_angles(theta: Any) -> np.ndarray:
    """Return angles as a new float64 array, by default 180 of them."""
    if theta is None:
        return _DEGREES.copy()
    angles = as_numbers(theta, "theta")
    if angles.ndim != 1 or not angles.size:
        raise ValueError(f"theta must be 1-D and not empty, got shape {angles.shape}")
    if not np.isfinite(angles).all():
        raise ValueError(f"theta must be finite, got {angles[~np.isfinite(angles)][0]}")
    return angles


def check_points(points: Any) -> Any:
    """Return `points` as an array of shape (N, 2), where N may be 0."""
    if not hasattr(points, "shape"):
        points = as_numbers(points, "points", np.float32)
    if len(points.shape) != 2 or points.shape[1] != 2:
        raise ValueError(f"points must have shape (N, 2), got {tuple(points.shape)}")
    return check_image(points, name="points") if len(points) else points
