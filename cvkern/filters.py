"""Linear filters, gradients and the median.

An image is (H, W), or (H, W, C) with `channel_axis`. Values are never rescaled by dtype; sums are
float32, in one order of operations, so that a result has the same bits on every device.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from cvkern._runtime import Runtime, runtime
from cvkern._validate import (
    check_channel_axis,
    check_choice,
    check_code,
    check_image,
    check_integer,
    check_number,
    check_out,
    check_pair,
)
from cvkern.kernels.codes import Border

OPERATORS = ("gaussian", "sobel", "scharr")

# Smoothing halves of the 3 x 3 operators; the other half is the difference (-1, 0, 1).
_SMOOTH = {"sobel": (1.0, 2.0, 1.0), "scharr": (3.0, 10.0, 3.0)}
_DIFFERENCE = (-1.0, 0.0, 1.0)


class Gradient(NamedTuple):
    """First derivatives of an image, and their polar form."""

    dy: Any
    """Derivative down the rows, (H, W) float32."""
    dx: Any
    """Derivative along the columns, (H, W) float32."""
    magnitude: Any
    """``sqrt(dy^2 + dx^2)``, (H, W) float32."""
    orientation: Any
    """``atan2(dy, dx)``, radians in (-pi, pi], (H, W) float32."""


def gaussian(
    image: Any,
    sigma: float | Sequence[float] = 1.0,
    *,
    order: int | Sequence[int] = 0,
    mode: str = "reflect",
    cval: float = 0.0,
    truncate: float = 4.0,
    channel_axis: int | None = None,
    out: Any = None,
) -> Any:
    """Convolve an image with a Gaussian or one of its derivatives.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C)
        Any real dtype.
    sigma : float or (float, float), default 1.0
        Standard deviation down the rows and along the columns, in pixels. 0 leaves an axis alone.
    order : int or (int, int), default 0
        Derivative of the Gaussian to convolve with, along each axis. An axis with `sigma` 0 is
        left alone whatever its order, as in :func:`scipy.ndimage.gaussian_filter`.
    mode : {'reflect', 'constant', 'nearest', 'mirror', 'wrap'}, default 'reflect'
        What lies outside the image, named as in :mod:`scipy.ndimage`.
    cval : float, default 0.0
        Value outside the image when `mode` is 'constant'.
    truncate : float, default 4.0
        Radius of the kernel in standard deviations; ``int(truncate * sigma + 0.5)`` pixels.
    channel_axis : int, optional
        Axis that is not filtered; needed for 3-D images.
    out : array of the shape of `image`, float32, optional
        Filled and returned when given.

    Returns
    -------
    array of the shape of `image`, float32
        Of the same library and on the same device as `image`.

    Raises
    ------
    TypeError
        If `image` does not hold real numbers.
    ValueError
        If `image` is empty or of another rank, `sigma`, `order` or `truncate` is negative or not
        finite, or `mode` is unknown.

    Notes
    -----
    Equal to :func:`scipy.ndimage.gaussian_filter` up to float32 rounding.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> step = np.repeat([[0, 0, 0, 1, 1, 1]], 2, axis=0)
    >>> cvkern.gaussian(step, 1.0).round(2)[0]
    array([0.01, 0.06, 0.3 , 0.7 , 0.94, 0.99], dtype=float32)
    """
    sigmas = [check_number(s, "sigma", low=0) for s in check_pair(sigma, "sigma")]
    orders = [check_integer(o, "order", 0, 32) for o in check_pair(order, "order")]
    truncate = check_number(truncate, "truncate", low=0)
    taps = [gaussian_taps(s, o, truncate) for s, o in zip(sigmas, orders, strict=True)]
    return _separable(image, taps, mode, cval, channel_axis, out)


@lru_cache(maxsize=64)
def gaussian_taps(sigma: float, order: int = 0, truncate: float = 4.0) -> np.ndarray:
    """Return the correlation taps of a Gaussian derivative, float32 of odd length.

    Derivatives follow from ``g' = -x / sigma^2 g``: g times a polynomial of degree `order`.
    """
    radius = int(truncate * sigma + 0.5)
    if radius == 0:
        return _frozen(np.ones(1))
    x = np.arange(-radius, radius + 1) / 1.0
    density = np.exp(-0.5 * (x / sigma) ** 2)
    density /= density.sum()
    polynomial = np.polynomial.Polynomial([1.0])
    for _ in range(order):
        polynomial = polynomial.deriv() - polynomial * np.polynomial.Polynomial([0, sigma**-2])
    # Correlation runs the other way round than the convolution: x becomes -x.
    return _frozen(polynomial(-x) * density)


def correlate_separable(
    image: Any,
    taps: Any,
    *,
    mode: str = "reflect",
    cval: float = 0.0,
    channel_axis: int | None = None,
    out: Any = None,
) -> Any:
    """Correlate an image with the outer product of two 1-D kernels.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C)
        Any real dtype.
    taps : sequence of float, or pair of them
        Kernel of odd length for both axes, or one down the rows and one along the columns. The
        middle tap weighs the pixel itself.
    mode, cval, channel_axis, out
        As in :func:`gaussian`.

    Returns
    -------
    array of the shape of `image`, float32

    Raises
    ------
    TypeError
        If `image` does not hold real numbers.
    ValueError
        If `image` is empty or of another rank, a kernel is empty, of even length or not finite,
        or `mode` is unknown.

    Notes
    -----
    As :func:`scipy.ndimage.correlate1d` along axis 0, then along axis 1.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.correlate_separable([[0, 0, 1, 1]], ([1], [-1, 0, 1]))
    array([[0., 1., 1., 0.]], dtype=float32)
    """
    pair = (taps, taps) if np.ndim(taps[0]) == 0 else tuple(taps)
    if len(pair) != 2:
        raise ValueError(f"taps must be one kernel or two, got {len(pair)}")
    return _separable(image, [_check_taps(t) for t in pair], mode, cval, channel_axis, out)


def box(
    image: Any,
    radius: int | Sequence[int] = 1,
    *,
    mode: str = "reflect",
    cval: float = 0.0,
    channel_axis: int | None = None,
    out: Any = None,
) -> Any:
    """Average each window of ``2 radius + 1`` pixels a side.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C)
        Any real dtype.
    radius : int or (int, int), default 1
        Half the side of the window, down the rows and along the columns, in pixels.
    mode, cval, channel_axis, out
        As in :func:`gaussian`.

    Returns
    -------
    array of the shape of `image`, float32

    Raises
    ------
    TypeError
        If `image` does not hold real numbers.
    ValueError
        If `image` is empty or of another rank, `radius` is negative, or `mode` is unknown.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.box([[0, 0, 3, 0, 0]], (0, 1))
    array([[0., 1., 1., 1., 0.]], dtype=float32)
    """
    radii = [check_integer(r, "radius", 0, 2**20) for r in check_pair(radius, "radius")]
    taps = [_frozen(np.full(2 * r + 1, 1 / (2 * r + 1))) for r in radii]
    return _separable(image, taps, mode, cval, channel_axis, out)


def sobel(image: Any, *, axis: int | None = None, mode: str = "reflect", cval: float = 0.0) -> Any:
    """Find edges by the Sobel operator.

    Parameters
    ----------
    image : array of shape (H, W)
        Any real dtype.
    axis : {0, 1}, optional
        Differentiate along this axis. When omitted, both derivatives are combined:
        ``sqrt((dy^2 + dx^2) / 2)``.
    mode, cval
        As in :func:`gaussian`.

    Returns
    -------
    array of shape (H, W), float32
        In units of `image` per pixel (the kernel's gain of 8 is divided out).

    Raises
    ------
    TypeError
        If `image` does not hold real numbers.
    ValueError
        If `image` is empty or not 2-D, or `axis` or `mode` is unknown.

    Notes
    -----
    Equal to :func:`skimage.filters.sobel` of the floating-point image; integers are not rescaled.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.sobel([[0, 0, 4, 4]] * 3, axis=1)[1]
    array([0., 2., 2., 0.], dtype=float32)
    """
    return _edge_strength(image, "sobel", axis, mode, cval)


def scharr(image: Any, *, axis: int | None = None, mode: str = "reflect", cval: float = 0.0) -> Any:
    """Find edges by the Scharr operator, which favours no direction.

    Parameters, results and errors are those of :func:`sobel`; equal to
    :func:`skimage.filters.scharr` of the floating-point image.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.scharr([[0, 0, 4, 4]] * 3, axis=1)[1]
    array([0., 2., 2., 0.], dtype=float32)
    """
    return _edge_strength(image, "scharr", axis, mode, cval)


def gradient(
    image: Any,
    *,
    sigma: float = 1.0,
    operator: str = "gaussian",
    mode: str = "reflect",
    cval: float = 0.0,
) -> Gradient:
    """Differentiate an image.

    Parameters
    ----------
    image : array of shape (H, W)
        Any real dtype.
    sigma : float, default 1.0
        Standard deviation of the Gaussian, in pixels. 0 smooths nothing, and is not possible with
        the operator 'gaussian'.
    operator : {'gaussian', 'sobel', 'scharr'}, default 'gaussian'
        'gaussian' convolves with the derivatives of the Gaussian: in units of `image` per pixel.
        'sobel' and 'scharr' smooth with the Gaussian, then apply the integer 3 x 3 kernels of
        :func:`cv2.Sobel` and :func:`cv2.Scharr`, with their gains of 8 and 32.
    mode, cval
        As in :func:`gaussian`.

    Returns
    -------
    Gradient
        Named tuple of `dy`, `dx`, `magnitude` and `orientation`, each (H, W) float32.

    Raises
    ------
    TypeError
        If `image` does not hold real numbers.
    ValueError
        If `image` is empty or not 2-D, `sigma` is negative or not finite, or 0 with the operator
        'gaussian', or `operator` or `mode` is unknown.

    Examples
    --------
    >>> import cvkern
    >>> ramp = [[0, 1, 2, 3, 4]] * 3
    >>> g = cvkern.gradient(ramp, sigma=0, operator="sobel")
    >>> g.dx[1], g.orientation[1, 2]
    (array([4., 8., 8., 8., 4.], dtype=float32), np.float32(0.0))
    """
    image = check_image(image)
    rt = runtime(image)
    results = Gradient(*(rt.empty(tuple(image.shape)) for _ in Gradient._fields))
    dy, dx, magnitude, orientation = (rt.adopt(a) for a in results)
    derivatives(rt, image, sigma, operator, mode, cval, dy, dx)
    rt.filters.polar(dy, dx, magnitude, orientation)
    return Gradient(*(rt.release(a) for a in results))


def derivatives(
    rt: Runtime,
    image: Any,
    sigma: float,
    operator: str,
    mode: str,
    cval: float,
    dy: Any,
    dx: Any,
) -> None:
    """Fill the kernel arrays `dy` and `dx` as :func:`gradient` says."""
    border = check_code(mode, Border, "mode")
    cval = check_number(cval, "cval")
    sigma = check_number(sigma, "sigma", low=0)
    check_choice(operator, OPERATORS, "operator")
    planes = (1, *image.shape)
    src = rt.adopt(image).reshape(planes)
    if operator == "gaussian":
        if sigma == 0:
            raise ValueError("sigma must be > 0 with the operator 'gaussian', got 0")
        smooth, slope = gaussian_taps(sigma), gaussian_taps(sigma, 1)
    else:
        smooth, slope = _frozen(_SMOOTH[operator]), _frozen(_DIFFERENCE)
        if sigma > 0:
            taps = rt.adopt(gaussian_taps(sigma))
            blurred = rt.scratch("derivatives.blurred", planes)
            rt.filters.correlate_separable(src, taps, taps, 1, border, cval, blurred)
            src = blurred
    smooth, slope = rt.adopt(smooth), rt.adopt(slope)
    rt.filters.correlate_separable(src, slope, smooth, 1, border, cval, dy.reshape(planes))
    rt.filters.correlate_separable(src, smooth, slope, 1, border, cval, dx.reshape(planes))


def median(
    image: Any,
    radius: int = 1,
    *,
    mode: str = "reflect",
    cval: float = 0.0,
    channel_axis: int | None = None,
    out: Any = None,
) -> Any:
    """Replace each pixel by the median of the window of ``2 radius + 1`` pixels a side.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C)
        Any real dtype. NaN counts as larger than every number.
    radius : int, default 1
        Half the side of the window: 1 (3 x 3) to 7 (15 x 15).
    mode, channel_axis
        As in :func:`gaussian`.
    cval : float, default 0.0
        Value outside the image when `mode` is 'constant'; must be a value of the image's dtype.
    out : array of the shape and dtype of `image`, optional
        Filled and returned when given.

    Returns
    -------
    array of the shape and dtype of `image`

    Raises
    ------
    TypeError
        If `image` does not hold real numbers.
    ValueError
        If `image` is empty or of another rank, `radius` is out of range, `mode` is unknown, or
        `cval` does not fit the dtype.

    Notes
    -----
    Equal to :func:`scipy.ndimage.median_filter` of that size, for every dtype.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> noisy = np.array([[1, 1, 9], [1, 7, 1], [2, 1, 1]], np.uint8)
    >>> cvkern.median(noisy)[1, 1]
    np.uint8(1)
    """
    raise ValueError(image)


def _separable(
    image: Any,
    taps: Sequence[np.ndarray],
    mode: str,
    cval: float,
    channel_axis: int | None,
    out: Any,
) -> Any:
    """Check what :func:`correlate_separable` and its special cases share, and run them."""
    image = check_image(image, ndim=(2, 3))
    axis = check_channel_axis(image.shape, channel_axis)
    border = check_code(mode, Border, "mode")
    cval = check_number(cval, "cval")
    check_out(out, image, np.float32)
    rt = runtime(image)
    planes, step = _layout(image.shape, axis)
    result = rt.empty(tuple(image.shape)) if out is None else out
    rt.filters.correlate_separable(
        rt.adopt(image).reshape(planes),
        rt.adopt(taps[0]),
        rt.adopt(taps[1]),
        step,
        border,
        cval,
        rt.adopt(result).reshape(planes),
    )
    return result if out is not None else rt.release(result)


def _layout(shape: tuple[int, ...], channel_axis: int | None) -> tuple[tuple[int, int, int], int]:
    """Return the shape (P, H, W step) that kernels see, and the step between neighbours."""
    if channel_axis is None:
        return (1, *shape), 1
    if channel_axis == 0:
        return shape, 1
    height, width, channels = shape
    return (1, height, width * channels), channels


def _edge_strength(image: Any, operator: str, axis: int | None, mode: str, cval: float) -> Any:
    if axis not in (None, 0, 1, -1, -2):
        raise ValueError(f"axis must be 0, 1 or None, got {axis}")
    smooth = np.array(_SMOOTH[operator])
    smooth, slope = smooth / smooth.sum(), np.array(_DIFFERENCE) / 2
    if axis is not None:
        taps = [slope, smooth] if axis % 2 == 0 else [smooth, slope]
        return _separable(image, [_frozen(t) for t in taps], mode, cval, None, None)
    raise ValueError


def _check_taps(taps: Any) -> np.ndarray:
    kernel = np.asarray(taps, np.float64)
    if kernel.ndim != 1 or kernel.size % 2 == 0:
        raise ValueError(f"taps must be 1-D and of odd length, got shape {kernel.shape}")
    if not np.isfinite(kernel).all():
        raise ValueError(f"taps must be finite, got {kernel}")
    return _frozen(kernel)


def _frozen(values: Any) -> np.ndarray:
    taps = np.array(values, np.float32)
    taps.flags.writeable = False
    return taps
