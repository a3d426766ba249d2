"""The Hough transform for ellipses."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import (
    MAX_ELEMENTS,
    check_beside,
    check_image,
    check_integer,
    check_number,
    check_positive,
    check_sides,
)
from cvkern._runtime import Runtime, runtime
from cvkern.hough._points import check_at_points, mask_points
from cvkern.kernels.codes.hough import MAX_BINS, EllipseBounds

FIELDS = ("accumulator", "yc", "xc", "a", "b", "orientation")  # fields of scikit-image
_TABLE = np.dtype({"names": FIELDS, "formats": ("intp", *5 * ("f8",))})
UNDIRECTED = -1.0  # code in place of a squared sine: ignore directions


class EllipseVotes(NamedTuple):
    """Ellipses in order of decreasing votes; ties are ordered by their pairs in raster order."""

    votes: Any
    """Points that agree on the minor axis, (N,) int32."""
    centers: Any
    """Row and column, in pixels with integer centres, (N, 2) float32."""
    axes: Any
    """Major and minor semi-axis in pixels, (N, 2) float32."""
    orientation: Any
    """Direction of the major axis, ``atan2(rows, columns)`` in (-pi / 2, pi / 2], (N,) float32."""

    def table(self) -> np.ndarray:
        """Return a structured array as :func:`skimage.transform.hough_ellipse` does.

        Returns
        -------
        array of shape (N,), of NumPy
            Its fields are `accumulator`, `yc`, `xc`, `a`, `b` and `orientation`, as
            :func:`skimage.draw.ellipse_perimeter` takes them. `a` is the major semi-axis, which
            runs down the rows at orientation 0; orientations are in [0, pi).

        Examples
        --------
        >>> import numpy as np
        >>> import cvkern
        >>> found = cvkern.hough_ellipse(np.eye(5), 0)
        >>> found.table().dtype.names
        ('accumulator', 'yc', 'xc', 'a', 'b', 'orientation')
        """
        found = np.zeros(len(self.votes), _TABLE)
        if len(found):
            rt = runtime(*self)
            dtypes = np.int32, np.float32, np.float32, np.float32
            host = [rt.to_numpy(rt.adopt(a, d)) for a, d in zip(self, dtypes, strict=True)]
            columns = host[0], *host[1].T, *host[2].T, np.mod(host[3] + np.pi / 2, np.pi)
            for name, values in zip(FIELDS, columns, strict=True):
                found[name] = values
        return found


def hough_ellipse(
    mask: Any,
    threshold: int = 4,
    accuracy: float = 1.0,
    min_size: float = 4.0,
    max_size: float | None = None,
    *,
    orientation: Any = None,
    orientation_tolerance: float = 0.2,
) -> EllipseVotes:
    """Find ellipses by votes for the minor axis, for each pair of set pixels as major axis.

    A pair of pixels, as the ends of the major axis, fixes the centre, the major axis and the
    orientation. Every other pixel then determines a minor axis, and votes for it in a histogram. So
    the accumulator has one dimension instead of five.

    Parameters
    ----------
    mask : array of shape (H, W)
        Edge pixels: any real dtype, set where it is not 0. The time grows with the cube of the
        number of set pixels.
    threshold : int, default 4
        An ellipse has more votes than this.
    accuracy : float, default 1.0
        Width of the bins of the minor semi-axis, in pixels. The first bin is centred on 0, the
        second on `accuracy`.
    min_size : float, default 4.0
        Smallest length of the (whole) major axis, in pixels.
    max_size : float, optional
        Largest minor semi-axis, in pixels. By default half the shorter side of the image.
    orientation : array of shape (H, W), optional
        Direction of the gradient in radians (:func:`cvkern.gradient`). Then the gradients of a
        pair must lie along the line between its pixels, and the gradient of a third pixel must be
        normal to the ellipse. This gives far fewer wrong votes, and takes less time.
    orientation_tolerance : float, default 0.2
        Largest error of a gradient's direction, in radians.

    Returns
    -------
    EllipseVotes
        Named tuple of `votes` (N,) int32, `centers` (N, 2), `axes` (N, 2) and `orientation` (N,)
        float32: one ellipse for each pair with enough votes. Its method `table` returns
        scikit-image's structured array.

    Raises
    ------
    TypeError
        If an array does not hold real numbers, or a parameter is not a number.
    ValueError
        If an array is empty, not 2-D, or longer than 65536 on a side, or the arrays differ in
        shape; if `threshold` is negative, `accuracy`, `min_size` or `max_size` not above 0,
        `accuracy` gives more than 8192 bins, or the tolerance is not in (0, pi / 2); if the mask
        has more than 23170 set pixels, whose pairs would take more than 2^31 bytes; if
        `orientation` is NaN or beyond a full turn at a set pixel.

    Notes
    -----
    A third pixel votes if it is no farther from the centre than the ends of the axis, and the minor
    semi-axis is at least half a pixel. Of bins with equal votes, the smaller one wins. In
    ``skimage.transform.hough_ellipse``, a third pixel votes if it is farther from the centre than
    `min_size` (scikit-image#7632), and the bins are those of the squared minor axis. The results
    are the same on every device and kernel set.

    References
    ----------
    .. [1] Y. Xie and Q. Ji, "A new efficient ellipse detection method", ICPR 2002.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> turn = np.linspace(0, 2 * np.pi, 60)
    >>> rows, columns = 10 + 5 * np.sin(turn), 15 + 9 * np.cos(turn)
    >>> mask = np.zeros((21, 31))
    >>> mask[np.rint(rows).astype(int), np.rint(columns).astype(int)] = 1
    >>> found = cvkern.hough_ellipse(mask, threshold=20)
    >>> found.centers[0], found.axes[0], found.orientation[0]
    (array([10., 15.], dtype=float32), array([9., 5.], dtype=float32), np.float32(0.0))
    """
    mask = check_image(mask, name="mask")
    shape = check_sides(mask.shape, "mask")
    threshold = check_integer(threshold, "threshold", 0, MAX_ELEMENTS)
    accuracy = check_positive(accuracy, "accuracy")
    shortest = check_positive(min_size, "min_size")
    widest = 0.5 * min(shape) if max_size is None else check_positive(max_size, "max_size")
    bins = widest / accuracy + 2.5  # infinite if the accuracy is denormal
    if bins >= MAX_BINS + 1:
        raise ValueError(f"accuracy must give at most {MAX_BINS} bins, got {bins:.0f}")
    tolerance = check_number(orientation_tolerance, "orientation_tolerance", low=0)
    if not 0 < tolerance < math.pi / 2:
        raise ValueError(f"orientation_tolerance must be in (0, pi / 2), got {tolerance:g}")
    orientation = check_beside(orientation, shape, "orientation")
    rt = runtime(mask, orientation)
    found = mask_points(rt, mask, "ellipses")
    angles = None if orientation is None else rt.adopt(orientation)
    if angles is not None:
        check_at_points(rt, found, angles, "orientation", -2 * math.pi, 2 * math.pi)
    count = int(rt.to_numpy(found.starts)[-1])
    pixels = rt.to_numpy(found.points)[:count]
    points = np.zeros((4, count), np.float32)
    points[:2] = pixels.T
    if angles is not None and count:
        turned = rt.to_numpy(angles)[tuple(pixels.T)].astype(np.float64)
        points[2:] = np.sin(turned), np.cos(turned)
    votes, pairs, minor = paired(
        rt, points, threshold, (shortest, math.inf), (0.5, widest), accuracy,
        UNDIRECTED if angles is None else math.sin(tolerance) ** 2,
    )  # fmt: skip
    ellipses = between(points[:2, pairs].astype(np.float64), minor)
    return EllipseVotes(rt.give(votes), *(rt.give(a.astype(np.float32)) for a in ellipses))


def paired(
    rt: Runtime,
    points: np.ndarray,
    threshold: int,
    lengths: tuple[float, float],
    widths: tuple[float, float],
    accuracy: float,
    turn: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return votes (N,), the pairs of points (2, N), and minor semi-axes, by decreasing votes.

    `points` are rows, columns, and sines and cosines of directions, (4, M). `lengths` are bounds
    of the major axis, `widths` bounds of the minor semi-axis.
    """
    count = points.shape[1]
    if count * count > MAX_ELEMENTS:
        raise ValueError(
            f"mask must have set pixels whose pairs take at most {4 * MAX_ELEMENTS} bytes, "
            f"got {4 * count * count} for {count} pixels"
        )
    if count < 3:
        return np.empty(0, np.int32), np.empty((2, 0), np.intp), np.empty(0)
    votes, axes = (rt.scratch(f"pairs.{name}", (count, count), np.int32) for name in ("n", "b"))
    shortest, longest = (min(a * a, 3e38) for a in lengths)
    narrow, wide = (b * b for b in widths)
    bins = math.floor(widths[1] / accuracy + 0.5) + 2
    bounds = EllipseBounds(shortest, longest, narrow, wide, 1 / accuracy, turn)
    rt.hough.ellipses.votes.vote_pairs(rt.send("pairs.points", points), bounds, bins, votes, axes)
    most = rt.to_numpy(votes)
    pairs = np.stack(np.nonzero(most > threshold))
    found = most[tuple(pairs)]
    order = np.argsort(-found, kind="stable")
    pairs = pairs[:, order]
    return found[order], pairs, rt.to_numpy(axes)[tuple(pairs)] * accuracy


def between(ends: np.ndarray, minor: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return centres, semi-axes and orientations of ellipses from axis ends, (2, 2, N).

    The first index of `ends` is row or column, the second the end.
    """
    rise, run = ends[:, 0] - ends[:, 1]
    turned = np.arctan2(rise, run)
    turned = np.where(turned > math.pi / 2, turned - math.pi, turned)
    turned = np.where(turned <= -math.pi / 2, turned + math.pi, turned)
    major = 0.5 * np.hypot(rise, run)
    return ends.mean(axis=1).T, np.stack((major, np.minimum(minor, major)), axis=1), turned
