"""Straight lines by voting: the Hough transform in (rho, theta) and in (m, c), and its peaks."""

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
from cvkern.hough._points import mask_points
from cvkern.hough.lines._tables import (
    SUBPIXEL,
    cast_votes,
    direction_windows,
    fixed_tables,
    line_tables,
    reach,
    subpixel_points,
)

_DEGREES = np.linspace(-math.pi / 2, math.pi / 2, 180, endpoint=False)
_STANDS_OUT = 2.8  # standard deviations that a bin is wide: 2 sqrt(2) 0.99


class HoughLine(NamedTuple):
    """An accumulator of lines and the meaning of its axes."""

    votes: Any
    """The votes for each distance and angle, (R, T) int32."""
    theta: np.ndarray
    """The angle of the lines' normal from the x axis towards the y axis, radians, (T,) float64."""
    rho: np.ndarray
    """The distance of the lines from pixel (0, 0) along the normal, pixels, (R,) float64."""


class HoughLineSlope(NamedTuple):
    """Two accumulators of lines, of one chart each, and the meaning of their axes."""

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
) -> HoughLine:
    """Let the points of an image vote for the lines through them.

    A line is ``x cos(theta) + y sin(theta) = rho``. Each point votes for all angles, and at each
    for the nearest distance; lines are where many votes meet.

    Parameters
    ----------
    mask : array of shape (H, W)
        The points are the pixels that are not zero; bool or any real dtype.
    theta : array of shape (T,), optional
        Angles, radians. By default 180, one degree apart, from -pi/2 on.
    points : array of shape (N, 2), optional
        Row and column of points, in place of `mask`; taken to 1/4096 of a pixel.
    shape : (int, int), optional
        Height and width of the image that `points` lie in; needed with them.
    rho_step : float, default 1.0
        Distance between neighbouring bins of rho, pixels.
    orientation : array of shape (H, W) or (N,), optional
        Direction of the gradient at the points, radians, as :func:`gradient` and
        :func:`subpixel_edges` give it. The points then vote only for lines across it: `theta`
        within `orientation_tolerance`, or the nearest one where none is. `theta` must ascend, and
        span less than half a turn.
    orientation_tolerance : float, default 0.0
        Radians.
    weights : array of shape (H, W) or (N,), optional
        Votes are sums of ``round(256 weight)`` over the points, instead of their number.

    Returns
    -------
    HoughLine
        Named tuple of `votes` (R, T) int32, `theta` (T,) and `rho` (R,); the latter two are NumPy
        arrays, whatever library the votes are of.

    Raises
    ------
    TypeError
        If an array does not hold real numbers.
    ValueError
        If not one of `mask` and `points` is given, or `points` without `shape`; an array is of
        the wrong shape or empty, or a side of the image is longer than 65536; points are not
        within the image; `theta` is not finite, or not as `orientation` needs it; `rho_step` is
        not positive; `orientation_tolerance` is negative; there is NaN in `orientation`, or a
        weight is negative, at a point; the votes could exceed int32, or would take too much
        memory.

    Notes
    -----
    With ``rho_step=1`` the angles, distances and votes are those of
    :func:`skimage.transform.hough_line`, but for ties. Rho is computed in fixed point, within
    ``(H + W) 2^-32`` pixels, which is less than 1e-5 up to 21000 x 21000; ties go to the larger
    bin. So votes are the same on every device and kernel set. Directions are first taken to the
    nearest of 16384 over the full turn.

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
        mask = check_image(mask, name="mask")
        size = check_sides(mask.shape, "mask")
    else:
        points = check_points(points)
        size = check_sides(shape, "shape")
    expected = size if points is None else (len(points),)
    orientation = check_beside(orientation, expected, "orientation")
    weights = check_beside(weights, expected, "weights")
    distances = reach(size, step)
    bins = 2 * distances + 1
    check_accumulator((bins, len(angles)), "votes")
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
    votes = rt.empty((bins, len(angles)), np.int32)
    # A line crosses each row, or each column, and has so many pixels of it in its bin.
    crossing = max(size) * (math.floor(math.sqrt(2) * step) + 1)
    view = rt.adopt(votes, np.int32)
    cast_votes(rt, found, tables, windows, orientation, weights, crossing, view)
    rho = step * np.arange(-distances, distances + 1.0)
    return HoughLine(rt.release(votes), angles, rho)


def hough_line_slope(mask: Any, slopes: Any = None, intercepts: Any = None) -> HoughLineSlope:
    """Let the set pixels of a mask vote for lines in slope and intercept, as Hough did.

    Parameters
    ----------
    mask : array of shape (H, W)
        The points are the pixels that are not zero; bool or any real dtype.
    slopes : array of shape (M,), optional
        Slopes m in [-1, 1]; by default 181, evenly spaced.
    intercepts : array of shape (C,), optional
        Intercepts c, evenly spaced and ascending, pixels. By default all whole numbers that
        points of the image can vote for.

    Returns
    -------
    HoughLineSlope
        Named tuple of `votes` and `swapped`, each (C, M) int32, `slopes` and `intercepts`.

    Raises
    ------
    TypeError
        If `mask` does not hold real numbers.
    ValueError
        If `mask` is empty, not 2-D or has a side longer than 65536; `slopes` are not a list of
        numbers in [-1, 1]; `intercepts` are not two or more, evenly spaced and ascending; or the
        votes would take too much memory.

    Notes
    -----
    A vertical line has no finite slope. So there are two charts: lines nearer to the x axis are
    ``y = m x + c`` with ``|m| <= 1``, and the others the same with the axes swapped. They show
    why (rho, theta), which :func:`hough_line` has, took their place (Duda and Hart 1972):

    - The intercepts range over ``W + H`` or more for slopes of either sign, though at each slope
      most of them are of no line through the image: rho needs only the image's half diagonal on
      either side of its centre.
    - Even steps of slope are uneven ones of angle, ``dtheta = dm / (1 + m^2)``: twice as wide at
      ``m = 0`` as at ``m = 1``. Nor is an even step of c one of distance, but
      ``drho = dc / sqrt(1 + m^2)``; so a line's votes depend on how it lies.
    - Lines at ``|m| = 1`` are in both charts, and a peak there must be merged from two.

    Bins are found in fixed point, as in :func:`hough_line`; ties go to the larger intercept.

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
    # From m = 1 at the far end of an axis to m = -1 at the far corner, in either chart.
    least, most = 1 - max(size), height + width - 2
    c = np.arange(least, most + 1.0) if intercepts is None else _check_intercepts(intercepts)
    step = float(c[-1] - c[0]) / (len(c) - 1) if len(c) > 1 else 1.0
    # The kernels check no bounds: they have all bins that can get a vote, and more if asked for.
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
    """Choose the bins of an accumulator from the size of the image and the error of its points.

    Parameters
    ----------
    shape : (int, int)
        Height and width of the image.
    localisation : float, default 0.3
        Standard deviation of the points from their line, pixels. Whole pixels of a thin edge have
        ``1 / sqrt(12) = 0.3`` from rounding alone; sub-pixel edges of a good photograph 0.05 to
        0.1.
    length : float, optional
        Length of the longest lines to be found whole, pixels. By default the image's diagonal.

    Returns
    -------
    LineBins
        Named tuple of `rho_step` and `theta`, for :func:`hough_line`.

    Raises
    ------
    TypeError
        If an argument is not a number.
    ValueError
        If a side of the image is not in [1, 65536], or `localisation` or `length` not positive.

    Notes
    -----
    Let the points deviate from their line by a normal error s. A bin of width w, centred on the
    line, gets the share ``erf(a)`` of its votes, where ``a = w / (2 sqrt(2) s)``. Chance votes
    grow with w, and so their fluctuation with ``sqrt(w)``. The peak stands out most where
    ``erf(a) / sqrt(a)`` is largest: at ``a = 0.99``, thus ``w = 2.8 s``, with 84 % of the votes.

    A line of length L between two angles, d apart, is off by ``d / 2`` at most, and so its ends
    by ``L d / 4``. They stay within the bin as long as that is ``w / 2``: ``d = 2 w / L``.

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
    """Return angles as a float64 array of their own, 180 of them by default."""
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
