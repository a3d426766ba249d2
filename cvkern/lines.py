"""Straight lines by voting: the Hough transform in (rho, theta) and in (m, c), and its peaks."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from cvkern._points import Points, mask_points
from cvkern._runtime import Runtime, refuse_capture, runtime
from cvkern._validate import check_accumulator, check_image, check_number, check_sides
from cvkern.kernels.codes import DIRECTIONS

SUBPIXEL = 4096  # sub-pixel points are taken to the nearest of so many parts of a pixel
WEIGHT = 256  # a weight of 1, in votes
_ANGLES = 8  # tables are padded to a multiple of this, for kernels that take so many at a time
_NOTHING = 1e-9  # radians by which angles may differ and be the same


class HoughLine(NamedTuple):
    """An accumulator of lines and the meaning of its axes."""

    votes: Any
    """The votes for each distance and angle, (R, T) int32."""
    theta: np.ndarray
    """The angle of the lines' normal from the x axis towards the y axis, radians, (T,) float64."""
    rho: np.ndarray
    """The distance of the lines from pixel (0, 0) along the normal, pixels, (R,) float64."""


class _Tables(NamedTuple):
    """What takes a point to its bin: ``(x cosine + y sine + offset) >> shift``."""

    cosine: np.ndarray
    sine: np.ndarray
    offset: np.ndarray
    shift: int
    rho: np.ndarray


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
    :func:`skimage.transform.hough_line`. Rho is computed in fixed point, within
    ``(H + W) 2^-32`` pixels, which is less than 1e-5; ties go to the larger bin. So votes are the
    same on every device and kernel set. Directions are first taken to the nearest of 16384 over
    the full turn.

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
    >>> mask = np.zeros((20, 30), bool)
    >>> mask[:, 12] = True
    >>> votes, theta, rho = cvkern.hough_line(mask)
    >>> r, t = np.unravel_index(votes.argmax(), votes.shape)
    >>> int(votes.max()), float(theta[t]), float(rho[r])
    (20, 0.0, 12.0)
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
    bins = 2 * _reach(size, step) + 1
    check_accumulator((bins, len(angles)), "votes")
    windows = None
    if orientation is not None:
        windows = direction_windows(angles.tobytes(), tolerance)
    rt = runtime(mask, points, orientation, weights)
    if points is None:
        found = mask_points(rt, mask, "hough_line")
        tables = line_tables(angles.tobytes(), step, size, 1)
    else:
        found = _subpixel_points(rt, points, size)
        tables = line_tables(angles.tobytes(), step, size, SUBPIXEL)
    votes = rt.empty((bins, len(angles)), np.int32)
    cast_votes(rt, found, tables, windows, orientation, weights, size, rt.adopt(votes, np.int32))
    return HoughLine(rt.release(votes), angles, tables.rho.copy())


def cast_votes(
    rt: Runtime,
    found: Points,
    tables: _Tables,
    windows: tuple[np.ndarray, np.ndarray] | None,
    orientation: Any,
    weights: Any,
    size: tuple[int, int],
    votes: Any,
) -> None:
    """Fill the kernel array `votes`; orientation and weights are images, or lists as the points."""
    cast: Any = None
    fixed = rt.constant(np.zeros(1, np.int32))
    if weights is not None:
        fixed = _fixed_weights(rt, found, weights, size, float(tables.rho[1] - tables.rho[0]))
    listed = rt.constant(tables.cosine), rt.constant(tables.sine), rt.constant(tables.offset)
    last = (*listed, tables.shift, weights is not None, fixed, votes)
    if windows is None:
        rt.lines.vote(found.points, found.starts, *last)
        return
    directions = values_at(rt, found, orientation, "orientation")
    check_listed(rt, found, directions, "orientation", -math.inf)
    cast = (rt.constant(windows[0]), rt.constant(windows[1]))
    rt.lines.vote_directed(found.points, found.starts, directions, *cast, *last)


def values_at(rt: Runtime, found: Points, values: Any, name: str) -> Any:
    """Return the float32 kernel list of `values` at the points, of an image or of their list."""
    if len(values.shape) == 1:
        return rt.adopt(values) if len(values) else rt.scratch(f"lines.{name}", (1,))
    taken = rt.scratch(f"lines.{name}", (max(found.capacity, 1),))
    rt.lines.take(found.points, found.starts, rt.adopt(values), taken)
    return taken


def check_listed(rt: Runtime, found: Points, listed: Any, name: str, low: float) -> np.ndarray:
    """Return the list on the host, once it is known to be finite and at least `low`."""
    refuse_capture(f"{name}, whose values are checked")
    number = int(rt.to_numpy(found.starts)[-1])
    host = rt.to_numpy(listed)[:number]
    wrong = ~(np.isfinite(host) & (host >= low))
    if wrong.any():
        i = int(wrong.argmax())
        row, column = rt.to_numpy(found.points)[i]
        rule = "finite" if low == -math.inf else f">= {low:g} and finite"
        raise ValueError(
            f"{name} must be {rule} at the points, got {host[i]:g} at point {i} of {number}"
        )
    return host


def _fixed_weights(
    rt: Runtime, found: Points, weights: Any, size: tuple[int, int], step: float
) -> Any:
    """Return the kernel list of weights in votes, of which no bin can get more than int32 holds."""
    listed = check_listed(rt, found, values_at(rt, found, weights, "weights"), "weights", 0)
    fixed = np.floor(listed.astype(np.float64) * WEIGHT + 0.5)
    most = fixed.sum()
    if len(weights.shape) == 2 and len(fixed):
        # A line crosses a row or a column, whichever has more pixels under it, in at most this.
        most = min(most, fixed.max() * max(size) * (math.floor(math.sqrt(2) * step) + 1))
    if most >= 2**31:
        raise ValueError(
            f"weights must be small enough for votes below 2^31, got up to {listed.max():g}"
        )
    return rt.adopt(fixed if len(fixed) else np.zeros(1), np.int32)


def _subpixel_points(rt: Runtime, points: Any, size: tuple[int, int]) -> Points:
    """Return checked (N, 2) points in fixed point."""
    refuse_capture("points, whose values are checked")
    host = rt.to_numpy(rt.adopt(points)) if len(points) else np.zeros((0, 2), np.float32)
    outside = ~((host >= -0.5) & (host <= np.array(size) - 0.5)).all(axis=1)
    if outside.any():
        raise ValueError(
            f"points must lie within the image of shape {tuple(size)}, "
            f"got ({', '.join(f'{v:g}' for v in host[outside.argmax()])})"
        )
    number = len(host)
    fixed = np.zeros((max(number, 1), 2), np.int32)
    fixed[:number] = np.floor(host.astype(np.float64) * SUBPIXEL + 0.5)
    return Points(rt.adopt(fixed, np.int32), rt.constant(np.array([number], np.int32)), number, 0)


def _reach(size: tuple[int, int], step: float) -> int:
    """Return how many bins of rho there are on either side of 0."""
    return math.ceil(math.sqrt(size[0] ** 2 + size[1] ** 2) / step)


@lru_cache(maxsize=32)
def line_tables(angles: bytes, step: float, size: tuple[int, int], parts: int) -> _Tables:
    """Return the fixed-point tables for float64 angles, and points in `parts` of a pixel.

    Cosine and sine have as many digits as int32 holds. What rounding them does is nothing at the
    centre of the image, as the offset there makes up for it, and most at its corners.
    """
    theta = np.frombuffer(angles)
    cosine, sine = np.cos(theta) / step, np.sin(theta) / step
    largest = max(np.abs(cosine).max(), np.abs(sine).max())
    shift = math.floor(math.log2((2**31 - 1) / largest))
    c, s = (np.round(v * 2.0**shift).astype(np.int64) for v in (cosine, sine))
    y, x = (n // 2 for n in size)
    reach = _reach(size, step)
    lost = np.round((x * cosine + y * sine) * 2.0**shift).astype(np.int64) - (x * c + y * s)
    offset = (reach << shift) + (1 << (shift - 1)) + lost
    fill = (0, -len(theta) % _ANGLES)
    return _Tables(
        np.pad(c, fill).astype(np.int32),
        np.pad(s, fill).astype(np.int32),
        np.pad(offset * parts, fill),
        shift + parts.bit_length() - 1,
        step * np.arange(-reach, reach + 1.0),
    )


@lru_cache(maxsize=32)
def direction_windows(angles: bytes, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the first angle, and the number of those that follow, for each direction code.

    Codes are over half a turn, and the angles a ring. Where no angle is within the tolerance the
    nearest is taken, the smaller of two, unless it is further than half the widest gap between
    neighbours: then the angles do not reach that direction.
    """
    theta = np.frombuffer(angles)
    if np.any(np.diff(theta) <= 0) or theta[-1] - theta[0] >= math.pi:
        raise ValueError(
            "theta must ascend, over less than half a turn, where orientation is given, "
            f"got {len(theta)} angles from {theta[0]:g} to {theta[-1]:g}"
        )
    codes = DIRECTIONS // 2
    ring = np.concatenate([theta - math.pi, theta, theta + math.pi])
    direction = theta[0] + np.mod(np.arange(codes) * (math.pi / codes) - theta[0], math.pi)
    reach = min(tolerance, math.pi / 2) + _NOTHING
    first = np.searchsorted(ring, direction - reach, "left")
    number = np.minimum(np.searchsorted(ring, direction + reach, "right") - first, len(theta))
    after = np.searchsorted(ring, direction)
    gaps = direction - ring[after - 1], ring[after] - direction
    gap = max(np.diff(theta).max(initial=0.0), math.pi if len(theta) == 1 else 0.0)
    nearest = np.where(gaps[0] <= gaps[1] + _NOTHING, after - 1, after)
    alone = (number < 1) & (np.minimum(*gaps) <= gap / 2 + _NOTHING)
    first = np.where(number < 1, nearest, first) % len(theta)
    return first.astype(np.int32), np.where(alone, 1, number).astype(np.int32)


def check_angles(theta: Any) -> np.ndarray:
    """Return angles as a float64 array of their own, 180 of them by default."""
    if theta is None:
        return np.linspace(-math.pi / 2, math.pi / 2, 180, endpoint=False)
    angles = np.array(theta, np.float64)
    if angles.ndim != 1 or not angles.size:
        raise ValueError(f"theta must be 1-D and not empty, got shape {angles.shape}")
    if not np.isfinite(angles).all():
        raise ValueError(f"theta must be finite, got {angles[~np.isfinite(angles)][0]}")
    return angles


def check_positive(value: Any, name: str) -> float:
    """Return `value` as a float above 0."""
    number = check_number(value, name, low=0)
    if not number:
        raise ValueError(f"{name} must be > 0, got {value}")
    return number


def check_points(points: Any) -> Any:
    """Return `points` as an array of shape (N, 2), where N may be 0."""
    if not hasattr(points, "shape"):
        points = np.asarray(points, np.float32)
    if len(points.shape) != 2 or points.shape[1] != 2:
        raise ValueError(f"points must have shape (N, 2), got {tuple(points.shape)}")
    return check_image(points, name="points") if len(points) else points


def check_beside(values: Any, shape: tuple[int, ...], name: str) -> Any:
    """Return `values` as an array of `shape`, of the mask or of the points, or None as it is."""
    if values is None:
        return None
    if not hasattr(values, "shape"):
        values = np.asarray(values)
    if tuple(values.shape) != tuple(shape):
        raise ValueError(f"{name} must have shape {tuple(shape)}, got {tuple(values.shape)}")
    return check_image(values, ndim=(1, 2), name=name) if len(values) else values
