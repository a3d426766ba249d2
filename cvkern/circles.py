"""The Hough transform for circles: votes, and the peaks among them."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from cvkern._libraries import library
from cvkern._points import check_at_points, mask_points
from cvkern._runtime import Runtime, runtime
from cvkern._validate import (
    MAX_ELEMENTS,
    check_accumulator,
    check_beside,
    check_image,
    check_integer,
    check_number,
    check_sides,
)
from cvkern.kernels.codes import DIRECTIONS

MAX_RADIUS = 2**14  # times the 2^16 of the tables of directions, within 32 bits
ALONG = -1  # the tolerance that says: the two pixels along the gradient, no arcs


class CirclePeaks(NamedTuple):
    """Circles by falling votes; of equal ones, by radius, row and column."""

    votes: Any
    """Votes or shares at the peak, (N,) float32."""
    column: Any
    """Column of the centre, (N,) int32."""
    row: Any
    """Row of the centre, (N,) int32."""
    radius: Any
    """Radius in pixels, (N,) int32."""


def hough_circle(
    mask: Any,
    radius: Any,
    *,
    normalize: bool = True,
    full_output: bool = False,
    orientation: Any = None,
    orientation_tolerance: float = 0.0,
) -> Any:
    """Count, for every centre and radius, the set pixels on the circle.

    Parameters
    ----------
    mask : array of shape (H, W)
        Edge pixels: any real dtype, set where it is not 0.
    radius : int or sequence of R ints
        Radii in pixels, from 1 to the diagonal of the image.
    normalize : bool, default True
        Divide the votes by the number of offsets of the circle: the share of it that is seen.
    full_output : bool, default False
        Also count for centres outside the image, as far as the largest radius reaches.
    orientation : array of shape (H, W), optional
        Direction of the gradient in radians (:func:`cvkern.gradient`). A set pixel then votes
        along its gradient alone, to both sides, in place of all round: far fewer wrong votes.
    orientation_tolerance : float, default 0.0
        Radians. 0: a pixel p votes for the two centres ``p +- round(radius * direction)``. Above
        0: for the offsets of the circle whose direction is at most this far from the gradient's,
        or from its opposite.

    Returns
    -------
    array of shape (R, H, W), or (R, H + 2 M, W + 2 M) with `full_output`, M the largest radius
        float32 shares, or int32 votes where `normalize` is False. The centre (row, column) is at
        ``[:, row + M, column + M]`` of the full output.

    Raises
    ------
    TypeError
        If an array does not hold real numbers, or a radius is not an integer.
    ValueError
        If an array is empty, not 2-D, longer than 65536 on a side, or they differ in shape; if
        there is no radius, or one is below 1, above 16384, or above the diagonal without
        `full_output`; if the result would have more than 2^29 elements; if `orientation` is NaN or
        beyond a full turn at a set pixel, or the tolerance is negative or not below pi / 2.

    Notes
    -----
    Without `orientation` the votes are those of ``skimage.transform.hough_circle``: its circles
    are Bresenham's, and count the four pixels on the axes twice, at some radii those on the
    diagonals too. With `orientation`, directions are taken to 1/16384 of a turn, and products of
    radius and direction rounded half up. The votes are the same on every device and kernel set.

    References
    ----------
    .. [1] R. O. Duda and P. E. Hart, "Use of the Hough transformation to detect lines and curves
       in pictures", Communications of the ACM 15(1), 1972.
    .. [2] C. Kimme, D. Ballard and J. Sklansky, "Finding circles by an array of accumulators",
       Communications of the ACM 18(2), 1975 (along the gradient).

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> y, x = np.mgrid[:21, :21]
    >>> ring = np.abs(np.hypot(y - 12, x - 9) - 6) < 0.5
    >>> votes = cvkern.hough_circle(ring, [5, 6, 7])
    >>> np.unravel_index(votes.argmax(), votes.shape)
    (np.int64(1), np.int64(12), np.int64(9))
    """
    mask = check_image(mask, name="mask")
    shape = check_sides(mask.shape, "mask")
    farthest = MAX_RADIUS if full_output else int(math.hypot(shape[0] - 1, shape[1] - 1))
    radii = _check_radii(radius, farthest)
    tolerance = check_number(orientation_tolerance, "orientation_tolerance", low=0)
    if tolerance >= math.pi / 2:
        raise ValueError(f"orientation_tolerance must be < pi / 2, got {tolerance:g}")
    orientation = check_beside(orientation, shape, "orientation")
    pad = max(radii) if full_output else 0
    size = (len(radii), shape[0] + 2 * pad, shape[1] + 2 * pad)
    check_accumulator(size, "votes")
    rt = runtime(mask, orientation)
    offsets, codes, starts = (rt.constant(table) for table in _rings(radii))
    dtype = np.float32 if normalize else np.int32
    votes = rt.empty(size, dtype)
    if orientation is None:
        given = library(mask).dtype(mask)
        view = rt.adopt(mask, given if given in (np.bool_, np.uint8) else np.bool_)
        rt.circles.vote_rings(view, offsets, starts, max(radii), rt.adopt(votes, dtype))
    else:
        angles = rt.adopt(orientation)
        found = mask_points(rt, mask, "circles")
        check_at_points(rt, found, angles, "orientation", -2 * math.pi, 2 * math.pi)
        units = min(round(tolerance * DIRECTIONS / (2 * math.pi)), DIRECTIONS // 4 - 1)
        rt.circles.vote_directed(
            found.points, found.starts, angles, rt.constant(np.array(radii, np.int32)),
            rt.constant(direction_table()), units if tolerance else ALONG, offsets, codes, starts,
            rt.adopt(votes, dtype),
        )  # fmt: skip
    return rt.release(votes)


def hough_circle_peaks(
    hspaces: Any,
    radii: Any,
    min_xdistance: int = 1,
    min_ydistance: int = 1,
    threshold: float | None = None,
    num_peaks: float = math.inf,
    total_num_peaks: float = math.inf,
    normalize: bool = False,
) -> CirclePeaks:
    """Find the circles that most votes are for.

    Parameters
    ----------
    hspaces : array of shape (R, H, W)
        What :func:`hough_circle` returned.
    radii : sequence of R ints
        The radii it was given.
    min_xdistance, min_ydistance : int, default 1
        In each accumulator a peak is the largest within so many columns and rows of itself. Above
        1 each, circles of different radii keep that distance from one another as well.
    threshold : float, optional
        Least votes of a peak, which has more. By default half the largest of each accumulator.
    num_peaks : int, optional
        Most peaks of an accumulator.
    total_num_peaks : int, optional
        Most peaks in all.
    normalize : bool, default False
        Order the peaks by votes over radius, against the bias to large circles where `hspaces`
        are counts.

    Returns
    -------
    CirclePeaks
        Named tuple of `votes`, `column`, `row` and `radius`, in the order of scikit-image.

    Raises
    ------
    TypeError
        If `hspaces` does not hold real numbers, or a distance or number is not an integer.
    ValueError
        If `hspaces` is empty or not 3-D, `radii` are not one of each, or below 1, a distance or
        number is below 1, or `threshold` is negative or not finite.

    Notes
    -----
    ``skimage.transform.hough_circle_peaks`` finds the same clear peaks. Of equal neighbours it
    takes the middle, this the first by row and column; and it looks for neighbours of columns near
    the border on the other side of the image, this does not.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> y, x = np.mgrid[:21, :21]
    >>> ring = np.abs(np.hypot(y - 12, x - 9) - 6) < 0.5
    >>> votes = cvkern.hough_circle(ring, [5, 6, 7])
    >>> peak = cvkern.hough_circle_peaks(votes, [5, 6, 7], total_num_peaks=1)
    >>> peak.row, peak.column, peak.radius
    (array([12], dtype=int32), array([9], dtype=int32), array([6], dtype=int32))
    """
    hspaces = check_image(hspaces, ndim=(3,), name="hspaces")
    planes = hspaces.shape[0]
    radii = np.array(_check_radii(radii, MAX_RADIUS, "radii"), np.int32)
    if len(radii) != planes:
        raise ValueError(f"radii must be one of each of {planes} accumulators, got {len(radii)}")
    apart = (
        check_integer(min_ydistance, "min_ydistance", 1, MAX_RADIUS),
        check_integer(min_xdistance, "min_xdistance", 1, MAX_RADIUS),
    )
    each, total = (
        None if n == math.inf else check_integer(n, name, 1, MAX_ELEMENTS)
        for n, name in ((num_peaks, "num_peaks"), (total_num_peaks, "total_num_peaks"))
    )
    if threshold is not None:
        threshold = check_number(threshold, "threshold", low=0)
    rt = runtime(hspaces)
    votes, places = local_maxima(rt, rt.adopt(hspaces), apart, threshold)
    order = np.lexsort((*places.T[::-1], -votes))
    if each is not None:  # the rank of each among the peaks of its own accumulator
        planes_of = places[order, 0]
        grouped = np.argsort(planes_of, kind="stable")
        firsts = np.searchsorted(planes_of[grouped], planes_of[grouped])
        order = order[np.sort(grouped[np.arange(len(grouped)) - firsts < each])]
    if normalize:
        ranked = votes[order] / radii[places[order, 0]].astype(np.float32)
        order = order[np.argsort(-ranked, kind="stable")]
    if apart != (1, 1):
        order = order[_spaced(places[order, 1:], apart)]
    order = order[:total]
    index, row, column = places[order].T
    return CirclePeaks(
        *(rt.give(a) for a in (votes[order], column.copy(), row.copy(), radii[index]))
    )


def local_maxima(
    rt: Runtime, votes: Any, apart: tuple[int, int], threshold: float | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the peaks of a float32 kernel array (P, H, W): votes (N,), and places (N, 3) int32.

    They are largest within `apart` rows and columns, and first of equals; above `threshold`, or
    half the largest of their plane. In raster order.
    """
    planes, height, _ = votes.shape
    limits = np.full(planes, threshold, np.float32)
    if threshold is None:
        tops = rt.scratch("peaks.tops", (planes * height,))
        rt.circles.row_maxima(votes, tops)
        limits = rt.to_numpy(tops).reshape(planes, height).max(axis=1) * np.float32(0.5)
    limits = rt.send("peaks.limits", limits)
    counts = rt.scratch("peaks.counts", (planes * height,), np.int32)
    rt.circles.count_peaks(votes, limits, *apart, counts)
    ends = np.zeros(planes * height + 1, np.int32)
    np.cumsum(rt.to_numpy(counts), out=ends[1:])
    total = int(ends[-1])
    if not total:
        return np.empty(0, np.float32), np.empty((0, 3), np.int32)
    starts = rt.send("peaks.starts", ends)
    places = rt.scratch("peaks.places", (total, 3), np.int32)
    values = rt.scratch("peaks.values", (total,))
    rt.circles.gather_peaks(votes, limits, *apart, starts, places, values)
    return rt.to_numpy(values).copy(), rt.to_numpy(places).copy()


def _check_radii(radius: Any, farthest: int, name: str = "radius") -> tuple[int, ...]:
    given = np.asarray(radius)
    if given.ndim > 1 or given.size == 0:
        raise ValueError(f"{name} must be one integer or a sequence of them, got {radius!r}")
    return tuple(check_integer(r, name, 1, farthest) for r in given.reshape(-1).tolist())


def _spaced(places: np.ndarray, apart: tuple[int, int]) -> np.ndarray:
    """Tell which places are apart from every kept one before them."""
    kept = np.zeros(len(places), bool)
    for i, place in enumerate(places):
        kept[i] = not (np.abs(places[kept] - place) <= apart).all(axis=1).any()
    return kept


@lru_cache(maxsize=8)
def _rings(radii: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the offsets of all circles (N, 2), their direction codes, and where each begins.

    The offsets of a circle stand in the order of their codes.
    """
    rings = [_ring(radius) for radius in radii]
    codes = [
        np.floor(np.arctan2(*ring.T) * (DIRECTIONS / (2 * math.pi)) + 0.5).astype(np.int32)
        % DIRECTIONS
        for ring in rings
    ]
    orders = [np.lexsort((*ring.T, code)) for ring, code in zip(rings, codes, strict=True)]
    return (
        np.concatenate([ring[order] for ring, order in zip(rings, orders, strict=True)]),
        np.concatenate([code[order] for code, order in zip(codes, orders, strict=True)]),
        np.cumsum([0, *map(len, rings)], dtype=np.int32),
    )


def _ring(radius: int) -> np.ndarray:
    """Return the offsets of a circle, (N, 2) int32, as Bresenham draws it, octant by octant.

    From (radius, 0) on, each step goes one column on, and one row up where that is nearer: where
    the squares of the two distances from the centre average at least that of the radius.
    """
    octant = []
    y, x = radius, 0
    while y >= x:
        octant.append((y, x))
        x += 1
        if 2 * x * x + y * y + (y - 1) * (y - 1) >= 2 * radius * radius:
            y -= 1
    one = np.array(octant, np.int32)
    both = np.concatenate((one, one[:, ::-1]))
    return np.concatenate([both * sign for sign in ((1, 1), (1, -1), (-1, 1), (-1, -1))]).astype(
        np.int32
    )


@lru_cache(maxsize=1)
def direction_table() -> np.ndarray:
    """Return sine and cosine of each direction code times 2^16, (DIRECTIONS, 2) int32."""
    angle = np.arange(DIRECTIONS) * (2 * math.pi / DIRECTIONS)
    return np.round(np.stack((np.sin(angle), np.cos(angle)), axis=1) * 65536).astype(np.int32)
