"""The lines with the most votes."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._arrays import library
from cvkern._checks import (
    FLOAT32_MAX,
    as_numbers,
    check_flag,
    check_image,
    check_integer,
    check_number,
)
from cvkern._runtime import Runtime, runtime

_DISTANCE, _ANGLE = 9, 10  # smallest number of bins between peaks, as in scikit-image


class HoughLinePeaks(NamedTuple):
    """Lines with many votes, most votes first."""

    votes: Any
    """The accumulator's values at the peaks, (K,) int32 or float32."""
    theta: np.ndarray
    """The angles, radians, (K,) float64."""
    rho: np.ndarray
    """The distances, pixels, (K,) float64."""


def hough_line_peaks(
    hspace: Any,
    angles: Any,
    dists: Any,
    min_distance: int = _DISTANCE,
    min_angle: int = _ANGLE,
    threshold: float | None = None,
    num_peaks: float = math.inf,
    *,
    refine: bool = False,
) -> HoughLinePeaks:
    """Find the lines with the most votes.

    A peak is above the threshold, and the largest value in its neighbourhood. If the angles span
    half a turn, the neighbourhood continues at the other end with the sign of rho changed, because
    the same lines follow there.

    Parameters
    ----------
    hspace : array of shape (R, T)
        The votes of :func:`hough_line`, smoothed or not; int32 or float32. Other dtypes are
        converted to these.
    angles, dists : array of shape (T,) and (R,)
        The theta and rho of :func:`hough_line`.
    min_distance, min_angle : int, default 9 and 10
        Half the size of the neighbourhood, in bins of rho and of theta.
    threshold : float, optional
        By default half of the largest vote.
    num_peaks : int, optional
        Largest number of peaks to keep; by default all.
    refine : bool, default False
        Move each peak to the maximum of the parabola through the bin and its two neighbours, in
        rho and in theta.

    Returns
    -------
    HoughLinePeaks
        Named tuple of `votes` (K,), int32 or float32 as in `hspace`, and of `theta` and `rho`
        (K,), which are always NumPy arrays; in order of decreasing votes. Of peaks with equal
        votes, the one with the smaller rho, then the smaller theta, comes first; in a
        neighbourhood, only this one is kept.

    Raises
    ------
    TypeError
        If `hspace` does not hold real numbers, or a size is not an integer.
    ValueError
        If `hspace` is empty, not 2-D or has NaN in it, `angles` or `dists` does not fit it or is
        not finite, a size is negative, or `threshold` is not a number.

    Notes
    -----
    The parameters and the peaks are those of :func:`skimage.transform.hough_line_peaks`, except
    for adjacent equal votes, which scikit-image replaces by one peak at their centre.

    Noise splits the peak of a line among neighbouring bins. Smooth the votes first, with
    ``cvkern.gaussian(votes, 1)``, to join them again.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> mask = np.zeros((40, 60), bool)
    >>> mask[10, :] = True
    >>> mask[:, 25] = True
    >>> votes, theta, rho = cvkern.hough_line_peaks(*cvkern.hough_line(mask))
    >>> votes.tolist(), theta.round(2).tolist(), rho.tolist()
    ([60, 40], [-1.57, 0.0], [-10.0, 25.0])
    """
    hspace = check_image(hspace, name="hspace")
    theta, rho = as_numbers(angles, "angles"), as_numbers(dists, "dists")
    for axis, name, values in ((1, "angles", theta), (0, "dists", rho)):
        if values.shape != (hspace.shape[axis],):
            raise ValueError(f"{name} must have shape ({hspace.shape[axis]},), got {values.shape}")
        if not (np.abs(values) <= FLOAT32_MAX).all():
            raise ValueError(f"{name} must be finite in float32, got some that are not")
    min_distance = check_integer(min_distance, "min_distance", 0, hspace.shape[0] + _DISTANCE)
    min_angle = check_integer(min_angle, "min_angle", 0, hspace.shape[1] + _ANGLE)
    unbounded = isinstance(num_peaks, float) and num_peaks == math.inf
    most = math.inf if unbounded else check_integer(num_peaks, "num_peaks", 0, 2**31)
    wraps = _spans_half_a_turn(theta)
    min_angle = min(min_angle, len(theta) // 2 if wraps else len(theta) - 1)
    refine = check_flag(refine, "refine")
    rt = runtime(hspace)
    whole = library(hspace).dtype(hspace).kind in "biu"
    if isinstance(hspace, np.ndarray) and whole and not -(2**31) <= hspace.max() < 2**31:
        raise ValueError(f"hspace must be votes that int32 holds, got {hspace.max()}")
    values = rt.adopt(hspace, np.int32 if whole else np.float32)
    host = rt.to_numpy(values)
    if not whole and np.isnan(host).any():
        raise ValueError("hspace must be votes, got some that are NaN")
    limit = 0.5 * float(host.max()) if threshold is None else check_number(threshold, "threshold")
    if whole:  # no vote lies beyond int32
        limit = math.floor(min(max(limit, -(2.0**31)), 2.0**31 - 1))
    else:
        limit = float(np.float32(limit))
    row, column = peak_bins(rt, values, limit, min_distance, min_angle, wraps)
    kept = len(row) if most == math.inf else int(most)
    bins = row[:kept], column[:kept]
    places = (theta[bins[1]], rho[bins[0]])
    if refine:
        places = _refined(host, theta, rho, bins, wraps)
    return HoughLinePeaks(rt.give(host[bins]), *places)


def _spans_half_a_turn(theta: np.ndarray) -> bool:
    """Tell whether the step from the last angle to the first plus half a turn is an ordinary one.

    This holds for the default angles of `hough_line`. It does not hold if the last angle equals the
    first plus half a turn, because its neighbours are then already present.
    """
    steps = np.diff(theta)
    if len(theta) < 2 or not (steps > 0).all():
        return False
    return 0.5 * steps.min() < theta[0] + math.pi - theta[-1] < 1.5 * steps.max()


def peak_bins(
    rt: Runtime, values: Any, limit: float, min_distance: int, min_angle: int, wraps: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return row and column of the peaks of a kernel array, the largest first."""
    mask = rt.scratch("peaks.mask", tuple(values.shape), bool)
    rt.hough.lines.peaks.local_maxima(values, limit, min_distance, min_angle, wraps, mask)
    starts = rt.scratch("peaks.starts", (values.shape[0] + 1,), np.int32)
    rt.hough.points.count(mask, starts)
    number = int(rt.to_numpy(starts)[-1])
    if not number:
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    bins = rt.scratch("peaks.bins", (number, 2), np.int32)
    taken = rt.scratch("peaks.taken", (number,), np.float64)
    rt.hough.points.gather(mask, starts, bins)
    rt.hough.lines.peaks.take(values, bins, taken)
    row, column = rt.to_numpy(bins).T.astype(np.intp)
    order = np.argsort(-rt.to_numpy(taken), kind="stable")
    return row[order], column[order]


def _refined(
    values: np.ndarray,
    theta: np.ndarray,
    rho: np.ndarray,
    bins: tuple[np.ndarray, np.ndarray],
    wraps: bool,
) -> tuple[np.ndarray, np.ndarray]:
    """Return angles and distances at the maxima of parabolas through three bins per axis."""
    row, column = bins
    last = len(rho) - 1

    def beside(side: int) -> np.ndarray:
        t = column + side
        beyond = (t < 0) | (t > len(theta) - 1)
        at = values[np.where(beyond, last - row, row), t % len(theta)]
        return np.where(beyond & (not wraps), np.nan, at)

    def across(side: int) -> np.ndarray:
        r = row + side
        return np.where((r < 0) | (r > last), np.nan, values[np.clip(r, 0, last), column])

    here = values[row, column].astype(np.float64)
    angle = theta[column] + _top(beside(-1), here, beside(1)) * _steps(theta)[column]
    return angle, rho[row] + _top(across(-1), here, across(1)) * _steps(rho)[row]


def _steps(values: np.ndarray) -> np.ndarray:
    """Return the step between neighbours at each of the values; 0 if there is only one value."""
    return np.gradient(values) if len(values) > 1 else np.zeros(len(values))


def _top(before: np.ndarray, here: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Return the offset of the parabola's maximum in [-0.5, 0.5]; 0 if a value is NaN."""
    with np.errstate(divide="ignore", invalid="ignore"):
        bend = 2 * here - before - after
        place = (after - before) / (2 * bend)
    return np.where(bend > 0, place, 0.0).clip(-0.5, 0.5)
