"""Corners: measures, peaks of a measure, and sub-pixel positions, as in scikit-image."""

from __future__ import annotations

import importlib
import math
from typing import Any

import numpy as np

from cvkern._arrays import library
from cvkern._checks import (
    as_array,
    check_choice,
    check_code,
    check_image,
    check_integer,
    check_number,
)
from cvkern._runtime import refuse_capture, runtime
from cvkern.filters.linear import frozen_taps, gaussian_taps
from cvkern.kernels.codes.features import Corner
from cvkern.kernels.codes.filters import Border

METHODS = ("k", "eps")
_SMOOTH = frozen_taps([1.0, 2.0, 1.0])
_SLOPE = frozen_taps([-1.0, 0.0, 1.0])


def corner_harris(
    image: Any,
    method: str = "k",
    k: float = 0.05,
    eps: float = 1e-6,
    sigma: float = 1.0,
    *,
    mode: str = "constant",
    cval: float = 0.0,
) -> Any:
    """Measure corners by the determinant and the trace of the structure tensor.

    Parameters
    ----------
    image : array of shape (H, W)
        Any real dtype.
    method : {'k', 'eps'}, default 'k'
        'k': ``det(A) - k trace(A)^2`` (Harris). 'eps': ``2 det(A) / (trace(A) + eps)`` (Noble).
    k : float, default 0.05
        Weight of the penalty for straight edges, typically in [0, 0.2].
    eps : float, default 1e-06
        Added to the trace in method 'eps'.
    sigma : float, default 1.0
        Standard deviation of the Gaussian weights of the products of derivatives, in pixels.
    mode : {'reflect', 'constant', 'nearest', 'mirror', 'wrap'}, default 'constant'
        Extension of the image, as in :func:`gaussian`.
    cval : float, default 0.0
        Value outside the image when `mode` is 'constant'.

    Returns
    -------
    array of shape (H, W), float32
        The measure: above 0 at corners.

    Raises
    ------
    TypeError
        If `image` does not hold real numbers.
    ValueError
        If `image` is empty or not 2-D, or an option is unknown or out of its range.

    Notes
    -----
    The values of :func:`skimage.feature.corner_harris` of the float image; values are not
    rescaled.

    References
    ----------
    .. [1] C. Harris and M. Stephens, "A combined corner and edge detector", Alvey Vision
       Conference, 1988.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> square = np.zeros((10, 10))
    >>> square[2:8, 2:8] = 1
    >>> cvkern.corner_peaks(cvkern.corner_harris(square))
    array([[2, 2],
           [2, 7],
           [7, 2],
           [7, 7]], dtype=int32)
    """
    rule = Corner.HARRIS if check_choice(method, METHODS, "method") == "k" else Corner.NOBLE
    k, eps = check_number(k, "k"), check_number(eps, "eps", low=0)
    return _measure(image, rule, k, eps, sigma, mode, cval)


def corner_shi_tomasi(
    image: Any, sigma: float = 1.0, *, mode: str = "constant", cval: float = 0.0
) -> Any:
    """Measure corners by the smaller eigenvalue of the structure tensor.

    Parameters
    ----------
    image : array of shape (H, W)
        Any real dtype.
    sigma, mode, cval
        As in :func:`corner_harris`.

    Returns
    -------
    array of shape (H, W), float32

    Raises
    ------
    TypeError
        If `image` does not hold real numbers.
    ValueError
        If `image` is empty or not 2-D, or an option is unknown or out of its range.

    Notes
    -----
    The values of :func:`skimage.feature.corner_shi_tomasi` of the float image.

    References
    ----------
    .. [1] J. Shi and C. Tomasi, "Good features to track", CVPR 1994.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> square = np.zeros((10, 10))
    >>> square[2:8, 2:8] = 1
    >>> cvkern.corner_shi_tomasi(square).round(2)[2, 1:4]
    array([1.59, 3.47, 2.36], dtype=float32)
    """
    return _measure(image, Corner.SHI_TOMASI, 0.0, 0.0, sigma, mode, cval)


def _measure(
    image: Any, rule: Corner, k: float, eps: float, sigma: float, mode: str, cval: float
) -> Any:
    image = check_image(image)
    sigma = check_number(sigma, "sigma", low=0)
    border = check_code(mode, Border, "mode")
    cval = check_number(cval, "cval")
    rt = runtime(image)
    shape = tuple(image.shape)
    flat = (math.prod(shape),)
    planes = (1, *shape)
    result = rt.empty(shape)
    src = rt.adopt(image, shape=planes)
    correlate = rt.filters.linear.correlate_separable
    smooth, slope = rt.constant(_SMOOTH), rt.constant(_SLOPE)
    taps = rt.constant(gaussian_taps(sigma))
    dy, dx, yy, yx, xx = (
        rt.scratch(f"corners.{name}", planes) for name in ("dy", "dx", "yy", "yx", "xx")
    )
    correlate(src, slope, smooth, 1, border, cval, dy)
    correlate(src, smooth, slope, 1, border, cval, dx)
    kernels = rt.features.corners
    kernels.multiply(*(a.reshape(flat) for a in (dy, dx, yy, yx, xx)))
    weighed = [rt.scratch(f"corners.weighed{i}", planes) for i in range(3)]
    for product, sums in zip((yy, yx, xx), weighed, strict=True):
        correlate(product, taps, taps, 1, border, cval, sums)
    a, b, c = (sums.reshape(flat) for sums in weighed)
    kernels.measure(a, b, c, rule, k, eps, rt.adopt(result, shape=flat))
    return rt.release(result)


def corner_peaks(
    image: Any,
    min_distance: int = 1,
    threshold_abs: float | None = None,
    threshold_rel: float | None = None,
    *,
    exclude_border: bool | int = True,
    num_peaks: int | None = None,
) -> Any:
    """Find the peaks of a measure of corners.

    Parameters
    ----------
    image : array of shape (H, W)
        The measure, for example from :func:`corner_harris`. Computed in float32.
    min_distance : int, default 1
        Peaks are the largest of ``2 min_distance + 1`` pixels a side; of peaks that are no
        farther apart than this, only the larger is kept, of equals the first.
    threshold_abs : float, optional
        A peak is larger than this; by default the least value.
    threshold_rel : float, optional
        A peak is larger than this share of the largest value.
    exclude_border : bool or int, default True
        Width of the border without peaks: `min_distance` (True), 0 (False), or a number of pixels.
    num_peaks : int, optional
        Largest number of peaks; the largest peaks are kept.

    Returns
    -------
    array of shape (N, 2), int32
        Rows and columns, the largest peak first; equal peaks are in raster order.

    Raises
    ------
    TypeError
        If `image` does not hold real numbers.
    ValueError
        If `image` is empty or not 2-D, or an option is out of its range.

    Notes
    -----
    The points of :func:`skimage.feature.corner_peaks`; where peaks are equal, its order may be
    another.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.corner_peaks([[0, 0, 0, 0], [0, 3, 0, 0], [0, 0, 0, 0]], exclude_border=False)
    array([[1, 1]], dtype=int32)
    """
    image = check_image(image)
    distance = check_integer(min_distance, "min_distance", 0, 2**16)
    margin = distance if exclude_border is True else 0
    if exclude_border is not True and exclude_border is not False:
        margin = check_integer(exclude_border, "exclude_border", 0, 2**16)
    most = None if num_peaks is None else check_integer(num_peaks, "num_peaks", 0, 2**31 - 1)
    low = None if threshold_abs is None else check_number(threshold_abs, "threshold_abs")
    share = None if threshold_rel is None else check_number(threshold_rel, "threshold_rel")
    refuse_capture("corner_peaks")
    rt = runtime(image)
    shape = tuple(image.shape)
    src = rt.adopt(image)
    values = rt.to_numpy(src)
    threshold = float(values.min()) if low is None else low
    if share is not None:
        threshold = max(threshold, share * float(values.max()))
    mask = rt.scratch("corners.mask", shape, np.uint8)
    rt.features.corners.mark_maxima(src, distance, threshold, margin, mask)
    points = np.argwhere(rt.to_numpy(mask))
    if len(points) == values.size:  # a flat image has no peaks
        points = points[:0]
    points = points[np.argsort(-values[points[:, 0], points[:, 1]], kind="stable")]
    points = _apart(points, distance)[:most]
    return rt.give(np.ascontiguousarray(points, np.int32).reshape(-1, 2))


def _apart(points: np.ndarray, distance: int) -> np.ndarray:
    """Leave out the points that are within a distance, along rows or columns, of an earlier one."""
    if not len(points) or not distance:
        return points
    spatial = importlib.import_module("scipy.spatial")
    pairs = spatial.cKDTree(points).query_pairs(distance, p=np.inf, output_type="ndarray")
    pairs = np.sort(pairs, axis=1)
    kept = np.ones(len(points), bool)
    for one, other in pairs[np.argsort(pairs[:, 0], kind="stable")].tolist():
        if kept[one]:
            kept[other] = False
    return points[kept]


def corner_subpix(image: Any, corners: Any, window_size: int = 11, alpha: float = 0.99) -> Any:
    """Refine corners to sub-pixel positions.

    Parameters
    ----------
    image : array of shape (H, W)
        Any real dtype.
    corners : array of shape (N, 2)
        Rows and columns; whole numbers.
    window_size : int, default 11
        Pixels along the side of the window about a corner: odd, from 3 to 255.
    alpha : float, default 0.99
        Significance of the decision between a corner of edges and a dot, above 0.5 and below 1.

    Returns
    -------
    array of shape (N, 2), float32
        Rows and columns; NaN where the decision between a corner and a dot is not significant.

    Raises
    ------
    TypeError
        If `image` does not hold real numbers.
    ValueError
        If an array has another shape, or an option is out of its range.

    Notes
    -----
    The values of :func:`skimage.feature.corner_subpix`, by sums in float64.

    References
    ----------
    .. [1] W. Foerstner and E. Guelch, "A fast operator for detection and precise location of
       distinct points, corners and centres of circular features", ISPRS 1987.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> checks = np.zeros((10, 10))
    >>> checks[:5, :5] = checks[5:, 5:] = 1
    >>> cvkern.corner_subpix(checks, [[4, 4]], window_size=7)
    array([[4.5, 4.5]], dtype=float32)
    """
    image = check_image(image)
    size = check_integer(window_size, "window_size", 3, 255)
    if size % 2 == 0:
        raise ValueError(f"window_size must be odd, got {size}")
    alpha = check_number(alpha, "alpha")
    if not 0.5 < alpha < 1:
        raise ValueError(f"alpha must be above 0.5 and below 1, got {alpha:g}")
    points = as_array(corners, "corners")
    if len(points.shape) != 2 or points.shape[1] != 2:
        raise ValueError(f"corners must have shape (N, 2), got {tuple(points.shape)}")
    rt = runtime(image, points)
    result = rt.empty(tuple(points.shape))
    if not points.shape[0]:
        return rt.release(result)
    if library(points).dtype(points).kind == "f" and isinstance(points, np.ndarray):
        if not (np.abs(points) < 2**31).all():
            raise ValueError("corners must be finite and below 2^31, got some that are not")
        points = np.trunc(points)
    freedom = size * size - 2
    stats = importlib.import_module("scipy.stats")
    dot, edge = (float(stats.f.isf(q, freedom, freedom)) for q in (1 - alpha, alpha))
    rt.features.corners.locate(
        rt.adopt(image), rt.adopt(points, np.int32), size // 2, dot, edge, rt.adopt(result)
    )
    return rt.release(result)
