"""Edge strength by the operators of 3 x 3 pixels: Sobel, Scharr, Prewitt, Laplace.

Sums are float32 in a fixed order of operations, so they have the same bits on every device.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import check_beside, check_code, check_integer, check_number, check_photograph
from cvkern._plans import planned
from cvkern._runtime import runtime
from cvkern._strips import in_strips
from cvkern.filters.channels import longest_slopes, planes_of
from cvkern.filters.gradients import DIFFERENCE, SMOOTH, differentiate, without_channels
from cvkern.filters.linear import frozen_taps, separable
from cvkern.kernels.codes.filters import Border

_MEAN = {name: frozen_taps(taps / taps.sum()) for name, taps in SMOOTH.items()}
_HERE = frozen_taps([0, 1, 0])
_BEND = frozen_taps([-1, 2, -1])


class _Options(NamedTuple):
    """The options that all operators share, as they are given."""

    mask: Any
    mode: str
    cval: float
    batch_axis: int | None


@planned
@in_strips
def sobel(
    image: Any,
    mask: Any = None,
    *,
    axis: int | None = None,
    mode: str = "reflect",
    cval: float = 0.0,
    batch_axis: int | None = None,
) -> Any:
    """Find edges by the Sobel operator.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C) with C in 3, 4, or a stack of them
        Any real dtype; colour as in :func:`gradient`.
    mask : array of the result's shape, optional
        The result is 0 where the mask is 0 at the pixel or at one of its eight neighbours, and in
        the outermost rows and columns.
    axis : {0, 1}, optional
        Differentiate along this axis. When omitted, both derivatives are combined:
        ``sqrt((dy^2 + dx^2) / 2)``.
    mode, cval, batch_axis
        As in :func:`gaussian`.

    Returns
    -------
    array of shape (H, W), or (N, H, W) of a stack, float32
        In units of `image`: a weighted mean of differences across two pixels.

    Raises
    ------
    TypeError
        If `image` or `mask` does not hold real numbers.
    ValueError
        If `image` is empty or of another shape, `mask` is not of the result's shape, or `axis` or
        `mode` is unknown.

    Notes
    -----
    Equal to :func:`skimage.filters.sobel` of a grey floating-point image; integers are not
    rescaled.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.sobel([[0, 0, 4, 4]] * 3, axis=1)[1]
    array([0., 4., 4., 0.], dtype=float32)
    """
    return _edge_strength(image, "sobel", axis, _Options(mask, mode, cval, batch_axis))


def sobel_h(image: Any, mask: Any = None, *, batch_axis: int | None = None) -> Any:
    """Find horizontal edges by the Sobel operator: ``sobel(image, mask, axis=0)``.

    Parameters
    ----------
    image, mask, batch_axis
        As in :func:`sobel`.

    Returns
    -------
    array of shape (H, W), or (N, H, W) of a stack, float32

    Raises
    ------
    TypeError, ValueError
        As :func:`sobel`.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.sobel_h([[0, 0, 0], [0, 0, 0], [4, 4, 4]])[:, 1]
    array([0., 4., 4.], dtype=float32)
    """
    return sobel(image, mask, axis=0, batch_axis=batch_axis)


def sobel_v(image: Any, mask: Any = None, *, batch_axis: int | None = None) -> Any:
    """Find vertical edges by the Sobel operator: ``sobel(image, mask, axis=1)``.

    Parameters
    ----------
    image, mask, batch_axis
        As in :func:`sobel`.

    Returns
    -------
    array of shape (H, W), or (N, H, W) of a stack, float32

    Raises
    ------
    TypeError, ValueError
        As :func:`sobel`.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.sobel_v([[0, 0, 4]] * 3)[1]
    array([0., 4., 4.], dtype=float32)
    """
    return sobel(image, mask, axis=1, batch_axis=batch_axis)


@planned
@in_strips
def scharr(
    image: Any,
    mask: Any = None,
    *,
    axis: int | None = None,
    mode: str = "reflect",
    cval: float = 0.0,
    batch_axis: int | None = None,
) -> Any:
    """Find edges by the Scharr operator, which favours no direction.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C) with C in 3, 4, or a stack of them
        Any real dtype; colour as in :func:`gradient`.
    mask, axis, mode, cval, batch_axis
        As in :func:`sobel`.

    Returns
    -------
    array of shape (H, W), or (N, H, W) of a stack, float32
        In units of `image`: a weighted mean of differences across two pixels.

    Raises
    ------
    TypeError, ValueError
        As :func:`sobel`.

    Notes
    -----
    Equal to :func:`skimage.filters.scharr` of a grey floating-point image; integers are not
    rescaled.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.scharr([[0, 0, 4, 4]] * 3, axis=1)[1]
    array([0., 4., 4., 0.], dtype=float32)
    """
    return _edge_strength(image, "scharr", axis, _Options(mask, mode, cval, batch_axis))


@planned
@in_strips
def prewitt(
    image: Any,
    mask: Any = None,
    *,
    axis: int | None = None,
    mode: str = "reflect",
    cval: float = 0.0,
    batch_axis: int | None = None,
) -> Any:
    """Find edges by the Prewitt operator, which weights the three pixels of a side alike.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C) with C in 3, 4, or a stack of them
        Any real dtype; colour as in :func:`gradient`.
    mask, axis, mode, cval, batch_axis
        As in :func:`sobel`.

    Returns
    -------
    array of shape (H, W), or (N, H, W) of a stack, float32
        In units of `image`: a mean of differences across two pixels.

    Raises
    ------
    TypeError, ValueError
        As :func:`sobel`.

    Notes
    -----
    Equal to :func:`skimage.filters.prewitt` of a grey floating-point image; integers are not
    rescaled.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.prewitt([[0, 0, 4, 4]] * 3, axis=1)[1]
    array([0., 4., 4., 0.], dtype=float32)
    """
    return _edge_strength(image, "prewitt", axis, _Options(mask, mode, cval, batch_axis))


@planned
@in_strips
def laplace(
    image: Any,
    ksize: int = 3,
    mask: Any = None,
    *,
    mode: str = "reflect",
    cval: float = 0.0,
    channel_axis: int | None = None,
    batch_axis: int | None = None,
) -> Any:
    """Find edges by the Laplace operator: four times a pixel less its four neighbours.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C), or a stack of them
        Any real dtype.
    ksize : int, default 3
        Side of the operator, pixels. There is one of 3 x 3 only, in scikit-image too, whatever its
        `ksize` is.
    mask : array of the result's shape, optional
        As in :func:`sobel`; not with `channel_axis`.
    mode, cval, channel_axis, batch_axis
        As in :func:`gaussian`.

    Returns
    -------
    array of the shape of `image`, float32
        Positive where a pixel is brighter than its neighbours.

    Raises
    ------
    TypeError, ValueError
        As :func:`sobel`; or if `ksize` is not 3, or `image` is a colour image and `channel_axis` is
        not given: a colour image has no single Laplacian.

    Notes
    -----
    Equal to :func:`skimage.filters.laplace` of a floating-point image; the sign is opposite to that
    of :func:`scipy.ndimage.laplace` and :func:`cv2.Laplacian`. Integers are not rescaled.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.laplace([[0, 0, 0], [0, 1, 0], [0, 0, 0]])
    array([[ 0., -1.,  0.],
           [-1.,  4., -1.],
           [ 0., -1.,  0.]], dtype=float32)
    """
    check_integer(ksize, "ksize", 3, 3)
    if channel_axis is not None:
        if mask is not None:
            raise ValueError("mask must be None with channel_axis, got one")
        return _laplace_of_channels(image, mode, cval, channel_axis, batch_axis)
    image = check_photograph(image, batch_axis=batch_axis)
    shape = without_channels(image, batch_axis)
    if tuple(image.shape) != shape:
        raise ValueError(
            f"image must be grey, or have a channel_axis, got shape {tuple(image.shape)}"
        )
    mask = check_beside(mask, shape, "mask")
    border, cval = check_code(mode, Border, "mode"), check_number(cval, "cval")
    rt = runtime(image, mask)
    result = rt.empty(shape)
    dst = rt.adopt(result)
    down, along = (rt.scratch(f"operators.{name}", shape) for name in ("dy", "dx"))
    src = planes_of(rt, image, batch_axis=batch_axis).values[0]
    differentiate(rt, src, _HERE, _BEND, border, cval, down, along)
    rt.filters.gradients.add(down, along, dst)
    if mask is not None:
        rt.filters.gradients.confine(rt.adopt(mask, bool), dst)
    return rt.release(result)


def _laplace_of_channels(
    image: Any, mode: str, cval: float, channel_axis: int, batch_axis: int | None
) -> Any:
    """Return the Laplacian of each channel."""
    down, along = (
        separable(image, taps, mode, cval, channel_axis, batch_axis)
        for taps in ((_BEND, _HERE), (_HERE, _BEND))
    )
    rt = runtime(down)
    shape = tuple(down.shape)
    flat = math.prod(shape[:-1]), shape[-1]
    result = rt.empty(shape)
    rt.filters.gradients.add(*(rt.adopt(a, shape=flat) for a in (down, along, result)))
    return rt.release(result)


def _edge_strength(image: Any, operator: str, axis: int | None, options: _Options) -> Any:
    if axis is not None and (not isinstance(axis, (int, np.integer)) or axis not in (0, 1)):
        raise ValueError(f"axis must be 0, 1 or None, got {axis!r}")
    mask, mode, cval, batch_axis = options
    image = check_photograph(image, batch_axis=batch_axis)
    shape = without_channels(image, batch_axis)
    mask = check_beside(mask, shape, "mask")
    border = check_code(mode, Border, "mode")
    cval = check_number(cval, "cval")
    even = border != Border.CONSTANT or cval == 0  # else sums outside differ from the pixels there
    if axis is not None and mask is None and even and tuple(image.shape) == shape:
        taps = (DIFFERENCE, _MEAN[operator]) if axis == 0 else (_MEAN[operator], DIFFERENCE)
        return separable(image, taps, mode, cval, batch_axis=batch_axis)
    rt = runtime(image, mask)
    result = rt.empty(shape)
    dst = rt.adopt(result)
    dy = dst if axis == 0 else rt.scratch("operators.dy", shape)
    dx = dst if axis == 1 else rt.scratch("operators.dx", shape)

    def fill(src: Any, down: Any, along: Any) -> None:
        differentiate(rt, src, _MEAN[operator], DIFFERENCE, border, cval, down, along)

    longest_slopes(rt, planes_of(rt, image, batch_axis=batch_axis), fill, dy, dx)
    if axis is None:
        rt.filters.gradients.root_mean_square(dy, dx, dst)
    if mask is not None:
        rt.filters.gradients.confine(rt.adopt(mask, bool), dst)
    return rt.release(result)
