"""The circles that most pixels voted for."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import (
    MAX_ELEMENTS,
    check_flag,
    check_image,
    check_integer,
    check_number,
)
from cvkern._runtime import Runtime, runtime
from cvkern.hough.circles.votes import MAX_RADIUS, _check_radii


class CirclePeaks(NamedTuple):
    """Circles in order of decreasing votes; ties are ordered by radius, row and column."""

    votes: Any
    """Votes or shares at the peak, (N,) float32."""
    column: Any
    """Column of the centre, (N,) int32."""
    row: Any
    """Row of the centre, (N,) int32."""
    radius: Any
    """Radius in pixels, (N,) int32."""


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
    """Find the circles with the most votes.

    Parameters
    ----------
    hspaces : array of shape (R, H, W)
        The result of :func:`hough_circle`. It must not have NaN in it, which is checked on the CPU
        alone.
    radii : sequence of R ints
        The radii that :func:`hough_circle` was given.
    min_xdistance, min_ydistance : int, default 1
        In its accumulator, a peak is the largest value within this many columns and rows. If both
        are above 1, circles of different radii keep this distance from one another as well.
    threshold : float, optional
        A peak has more votes than this. By default half the largest value of each accumulator.
    num_peaks : int, optional
        Largest number of peaks in one accumulator.
    total_num_peaks : int, optional
        Largest number of peaks in all accumulators together.
    normalize : bool, default False
        Order the peaks by votes divided by radius. If `hspaces` are counts, this removes the bias
        towards large circles.

    Returns
    -------
    CirclePeaks
        Named tuple of `votes`, `column`, `row` and `radius`, in the order of scikit-image.

    Raises
    ------
    TypeError
        If `hspaces` does not hold real numbers, or a distance or number is not an integer.
    ValueError
        If `hspaces` is empty or not 3-D, `radii` are not one per accumulator or below 1, a
        distance or number is below 1, or `threshold` is negative or not finite.

    Notes
    -----
    ``skimage.transform.hough_circle_peaks`` finds the same clear peaks. If neighbours are equal,
    scikit-image takes the middle one; this function takes the first by row and column. Near the
    left and right borders, scikit-image also compares with columns at the opposite side of the
    image; this function does not.

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
        raise ValueError(f"radii must be one for each of {planes} accumulators, got {len(radii)}")
    apart = (
        check_integer(min_ydistance, "min_ydistance", 1, MAX_RADIUS),
        check_integer(min_xdistance, "min_xdistance", 1, MAX_RADIUS),
    )
    each, total = (
        None if isinstance(n, float) and n == math.inf else check_integer(n, name, 1, MAX_ELEMENTS)
        for n, name in ((num_peaks, "num_peaks"), (total_num_peaks, "total_num_peaks"))
    )
    if threshold is not None:
        threshold = check_number(threshold, "threshold", low=0)
    rt = runtime(hspaces)
    given = rt.adopt(hspaces)
    if rt.device == "cpu" and np.isnan(rt.host_view(given).max()):
        raise ValueError("hspaces must be votes, got some that are NaN")
    votes, places = local_maxima(rt, given, apart, threshold)
    order = np.lexsort((*places.T[::-1], -votes))
    if each is not None:  # rank each peak within its own accumulator
        planes_of = places[order, 0]
        grouped = np.argsort(planes_of, kind="stable")
        firsts = np.searchsorted(planes_of[grouped], planes_of[grouped])
        order = order[np.sort(grouped[np.arange(len(grouped)) - firsts < each])]
    if check_flag(normalize, "normalize"):
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
    """Return the peaks of a float32 kernel array (P, H, W): votes (N,), and indices (N, 3) int32.

    A peak is the largest value within `apart` rows and columns, the first of equal ones, and above
    `threshold`, or above half the largest value of its plane. Peaks are in raster order.
    """
    planes, height, _ = votes.shape
    limits = np.full(planes, threshold, np.float32)
    if threshold is None:
        tops = rt.scratch("peaks.tops", (planes * height,))
        rt.hough.circles.peaks.row_maxima(votes, tops)
        limits = rt.to_numpy(tops).reshape(planes, height).max(axis=1) * np.float32(0.5)
    limits = rt.send("peaks.limits", limits)
    counts = rt.scratch("peaks.counts", (planes * height,), np.int32)
    rt.hough.circles.peaks.count_peaks(votes, limits, *apart, counts)
    ends = np.zeros(planes * height + 1, np.int32)
    np.cumsum(rt.to_numpy(counts), out=ends[1:])
    total = int(ends[-1])
    if not total:
        return np.empty(0, np.float32), np.empty((0, 3), np.int32)
    starts = rt.send("peaks.starts", ends)
    places = rt.scratch("peaks.places", (total, 3), np.int32)
    values = rt.scratch("peaks.values", (total,))
    rt.hough.circles.peaks.gather_peaks(votes, limits, *apart, starts, places, values)
    return rt.to_numpy(values).copy(), rt.to_numpy(places).copy()


def _spaced(places: np.ndarray, apart: tuple[int, int]) -> np.ndarray:
    """Return a mask of the places that are apart from all kept places before them."""
    kept = np.zeros(len(places), bool)
    for i, place in enumerate(places):
        kept[i] = not (np.abs(places[kept] - place) <= apart).all(axis=1).any()
    return kept
