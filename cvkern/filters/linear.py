"""Linear filters.

An image is (H, W), or (H, W, C) with `channel_axis`. Values are never rescaled by dtype. Sums are
float32 in a fixed order of operations, so a result has the same bits on every device.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from cvkern._arrays import library
from cvkern._checks import (
    as_numbers,
    check_axes,
    check_code,
    check_image,
    check_integer,
    check_number,
    check_out,
    check_pair,
)
from cvkern._plans import planned
from cvkern._runtime import runtime
from cvkern._strips import in_strips
from cvkern.filters.depths import as_floats, check_result
from cvkern.kernels.codes.filters import Border

MAX_RADIUS = 2**20
NO_SIGMA = 1e-15  # largest sigma that does not smooth, as in scipy.ndimage


@planned
@in_strips
def gaussian(
    image: Any,
    sigma: float | Sequence[float] = 1.0,
    *,
    order: int | Sequence[int] = 0,
    mode: str = "reflect",
    cval: float = 0.0,
    truncate: float = 4.0,
    channel_axis: int | None = None,
    batch_axis: int | None = None,
    dtype: Any = None,
    out: Any = None,
) -> Any:
    """Convolve an image with a Gaussian or one of its derivatives.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C), or a stack of them
        Any real dtype.
    sigma : float or (float, float), default 1.0
        Standard deviation down the rows and along the columns, in pixels. 0 does not filter an
        axis.
    order : int or (int, int), default 0
        Order of the Gaussian's derivative along each axis. An axis with `sigma` 0 is not filtered,
        whatever its order, as in :func:`scipy.ndimage.gaussian_filter`.
    mode : {'reflect', 'constant', 'nearest', 'mirror', 'wrap'}, default 'reflect'
        How the image continues outside, named as in :mod:`scipy.ndimage`.
    cval : float, default 0.0
        Value outside the image when `mode` is 'constant'.
    truncate : float, default 4.0
        Radius of the kernel in standard deviations; ``int(truncate * sigma + 0.5)`` pixels.
    channel_axis : int, optional
        Axis that is not filtered; needed for images with channels.
    batch_axis : {0}, optional
        Axis of the images in a stack, (N, H, W) or with channels; all are filtered in one launch.
    dtype : {'float32', 'uint8', 'uint16'}, optional
        The dtype of the result, by default float32. Integers are rounded to the nearest, half to
        even; values beyond their range become its limits.
    out : array of the shape of `image` and of `dtype`, optional
        Filled and returned when given.

    Returns
    -------
    array of the shape of `image`, float32 or `dtype`
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
    array([0.  , 0.06, 0.3 , 0.7 , 0.94, 1.  ], dtype=float32)
    """
    sigmas = [check_number(s, "sigma", low=0) for s in check_pair(sigma, "sigma")]
    orders = [check_integer(o, "order", 0, 32) for o in check_pair(order, "order")]
    truncate = check_number(truncate, "truncate", low=0)
    for s in sigmas:
        check_radius(truncate * s)
    taps = [gaussian_taps(s, o, truncate) for s, o in zip(sigmas, orders, strict=True)]
    return separable(image, taps, mode, cval, channel_axis, batch_axis, dtype, out)


@lru_cache(maxsize=64)
def gaussian_taps(sigma: float, order: int = 0, truncate: float = 4.0) -> np.ndarray:
    """Return the correlation taps of a Gaussian derivative, float32 of odd length.

    Derivatives follow from ``g' = -x / sigma^2 g``: g times a polynomial of degree `order`.
    """
    if sigma <= NO_SIGMA:
        return frozen_taps([1.0])
    check_radius(truncate * sigma)
    radius = int(truncate * sigma + 0.5)
    x = np.arange(-radius, radius + 1, dtype=np.float64)
    density = np.exp(-0.5 * (x / sigma) ** 2)
    density /= density.sum()
    polynomial = np.polynomial.Polynomial([1.0])
    for _ in range(order):
        polynomial = polynomial.deriv() - polynomial * np.polynomial.Polynomial([0, sigma**-2])
    # A correlation is a convolution with the kernel reversed: x becomes -x.
    return frozen_taps(polynomial(-x) * density)


def check_radius(radius: float) -> None:
    """Refuse a Gaussian so wide that its kernel alone would fill the memory."""
    if radius > MAX_RADIUS:
        raise ValueError(f"sigma must reach at most {MAX_RADIUS} pixels, got {radius:g}")


@planned
@in_strips
def correlate_separable(
    image: Any,
    taps: Any,
    *,
    mode: str = "reflect",
    cval: float = 0.0,
    channel_axis: int | None = None,
    batch_axis: int | None = None,
    dtype: Any = None,
    out: Any = None,
) -> Any:
    """Correlate an image with the outer product of two 1-D kernels.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C), or a stack of them
        Any real dtype.
    taps : sequence of float, or pair of them
        Kernel of odd length for both axes, or one down the rows and one along the columns. The
        middle tap weighs the pixel itself.
    mode, cval, channel_axis, batch_axis, dtype, out
        As in :func:`gaussian`.

    Returns
    -------
    array of the shape of `image`, float32 or `dtype`

    Raises
    ------
    TypeError
        If `image` does not hold real numbers.
    ValueError
        If `image` is empty or of another rank, a kernel is empty, of even length or not finite,
        or `mode` is unknown.

    Notes
    -----
    Equal to :func:`scipy.ndimage.correlate1d` along axis 0, then along axis 1, up to float32
    rounding.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.correlate_separable([[0, 0, 1, 1]], ([1], [-1, 0, 1]))
    array([[0., 1., 1., 0.]], dtype=float32)
    """
    try:
        kernels = [taps, taps] if all(np.ndim(t) == 0 for t in taps) else list(taps)
    except Exception:  # another library may raise anything when asked for its values
        raise TypeError(f"taps must be a sequence, got {taps!r}") from None
    if len(kernels) != 2:
        raise ValueError(f"taps must be one kernel or two, got {len(kernels)}")
    taps = [_check_taps(t) for t in kernels]
    return separable(image, taps, mode, cval, channel_axis, batch_axis, dtype, out)


@planned
@in_strips
def box(
    image: Any,
    radius: int | Sequence[int] = 1,
    *,
    mode: str = "reflect",
    cval: float = 0.0,
    channel_axis: int | None = None,
    batch_axis: int | None = None,
    dtype: Any = None,
    out: Any = None,
) -> Any:
    """Average each window of ``2 radius + 1`` pixels a side.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C), or a stack of them
        Any real dtype.
    radius : int or (int, int), default 1
        Half the side of the window, down the rows and along the columns, in pixels.
    mode, cval, channel_axis, batch_axis, dtype, out
        As in :func:`gaussian`.

    Returns
    -------
    array of the shape of `image`, float32 or `dtype`

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
    radii = [check_integer(r, "radius", 0, MAX_RADIUS) for r in check_pair(radius, "radius")]
    taps = [_box_taps(r) for r in radii]
    return separable(image, taps, mode, cval, channel_axis, batch_axis, dtype, out)


@lru_cache(maxsize=64)
def _box_taps(radius: int) -> np.ndarray:
    return frozen_taps(np.full(2 * radius + 1, 1 / (2 * radius + 1)))


def separable(
    image: Any,
    taps: Sequence[np.ndarray],
    mode: str,
    cval: float,
    channel_axis: int | None = None,
    batch_axis: int | None = None,
    dtype: Any = None,
    out: Any = None,
) -> Any:
    """Check and run :func:`correlate_separable` or one of its special cases."""
    image = check_image(image, ndim=(2, 3) if batch_axis is None else (3, 4))
    axis = check_axes(image.shape, channel_axis, batch_axis)
    border = check_code(mode, Border, "mode")
    cval = check_number(cval, "cval")
    kind = check_result(dtype)
    check_out(out, image, kind)
    rt = runtime(image)
    shape = tuple(image.shape)
    result = rt.empty(shape, kind, out=out)
    whole = kind != np.float32
    down, along = (rt.constant(t) for t in taps)
    if whole and axis != 1 and library(image).dtype(image) == kind:
        planes, step = image_layout(shape, axis, batch_axis)
        given = rt.adopt(image, kind, planes), down, along, step, border, cval
        rt.filters.linear.correlate_separable(*given, rt.adopt(result, kind, planes))
        return rt.release(result, out)
    floats = rt.scratch("separable.floats", shape) if whole else rt.adopt(result)
    if axis == 1:
        # A step between columns would leave its row, so filter each axis separately.
        images = 1 if batch_axis is None else shape[0]
        height, channels, width = shape[-3:]
        middle = rt.scratch("separable.middle", (images, height, channels * width))
        alone = rt.constant(_ALONE)
        src, dst = as_floats(rt, image, middle.shape), (1, images * height * channels, width)
        rt.filters.linear.correlate_separable(src, down, alone, 1, border, cval, middle)
        rt.filters.linear.correlate_separable(
            middle.reshape(dst), alone, along, 1, border, cval, floats.reshape(dst)
        )
    else:
        planes, step = image_layout(shape, axis, batch_axis)
        src, dst = as_floats(rt, image, planes), floats.reshape(planes)
        rt.filters.linear.correlate_separable(src, down, along, step, border, cval, dst)
    if whole:
        rt.filters.depths.narrow(floats, rt.adopt(result, kind))
    return rt.release(result, out)


def image_layout(
    shape: tuple[int, ...], channel_axis: int | None, batch_axis: int | None
) -> tuple[tuple[int, int, int], int]:
    """Return the shape (P, H, W step) that kernels see, and the step between neighbours.

    `channel_axis` counts within one image, and is not 1.
    """
    images, one = (1, shape) if batch_axis is None else (shape[0], shape[1:])
    if channel_axis is None:
        return (images, one[0], one[1]), 1
    if channel_axis == 0:
        return (images * one[0], one[1], one[2]), 1
    height, width, channels = one
    return (images, height, width * channels), channels


def _check_taps(taps: Any) -> np.ndarray:
    kernel = as_numbers(taps, "taps")
    if kernel.ndim != 1 or kernel.size % 2 == 0:
        raise ValueError(f"taps must be 1-D and of odd length, got shape {kernel.shape}")
    if not (np.abs(kernel) <= np.finfo(np.float32).max).all():
        raise ValueError(f"taps must be finite, got {kernel}")
    return frozen_taps(kernel)


def frozen_taps(values: Any) -> np.ndarray:
    """Return `values` as a read-only float32 array."""
    taps = np.array(values, np.float32)
    taps.flags.writeable = False
    return taps


_ALONE = frozen_taps([1.0])
