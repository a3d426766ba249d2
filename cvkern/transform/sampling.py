"""Sampling of an image at given coordinates, and its gradients."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cvkern._arrays import library
from cvkern._checks import check_channel_axis, check_code, check_image, check_integer, check_number
from cvkern._runtime import Runtime, runtime
from cvkern.kernels.codes.filters import Border
from cvkern.kernels.codes.transform import SPLINE_PAD

ORDERS = (0, 1, 3)


class RemapGradient(NamedTuple):
    """Gradients of a loss with respect to the inputs of :func:`remap`."""

    image: Any
    coordinates: Any


def remap(
    image: Any,
    coordinates: Any,
    order: int = 1,
    *,
    mode: str = "constant",
    cval: float = 0.0,
    channel_axis: int | None = None,
    dtype: Any = None,
) -> Any:
    """Sample an image at coordinates by a spline.

    Parameters
    ----------
    image : array of shape (H, W), (H, W, C) or (C, H, W)
        Any real dtype.
    coordinates : array of shape (2, H', W')
        Rows and columns, in pixels; pixel centres are integers. Read as float32.
    order : {0, 1, 3}, default 1
        Nearest pixel, linear, or the cubic spline through all pixels.
    mode : {'reflect', 'constant', 'nearest', 'mirror', 'wrap'}, default 'constant'
        Extension of the image, named as in :mod:`scipy.ndimage`.
    cval : float, default 0.0
        Value outside the image when `mode` is 'constant'. In any mode, it is the value at
        coordinates that are not numbers or as large as 1e9.
    channel_axis : int, optional
        Axis of the channels, the first or the last; needed for 3-D images.
    dtype : dtype, optional
        float32, or uint8: rounded (halves up) and cut off at 0 and 255. By default that of
        `image` where it is uint8 and `order` is 0, else float32.

    Returns
    -------
    array of shape (H', W'), (H', W', C) or (C, H', W'), float32 or uint8
        The samples, in the same library and on the same device as `image`.

    Raises
    ------
    TypeError
        If `image` or `coordinates` do not hold real numbers, or `dtype` is another.
    ValueError
        If an array is empty or of a wrong shape, `order` or `mode` is unknown, or `cval` is not
        finite.

    Notes
    -----
    Equal to :func:`scipy.ndimage.map_coordinates` up to float32 rounding.

    References
    ----------
    .. [1] P. Thevenaz and others, "Interpolation revisited", IEEE Transactions on Medical
       Imaging 19(7), 2000.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> rows, columns = np.mgrid[:2, :2] + 0.5
    >>> cvkern.remap([[0, 1, 2], [3, 4, 5], [6, 7, 8]], np.stack((rows, columns)))
    array([[2., 3.],
           [5., 6.]], dtype=float32)
    """
    image, axis, order, border, cval = check_sampled(image, order, mode, cval, channel_axis)
    coordinates = _check_coordinates(coordinates)
    rt = runtime(image, coordinates)
    made = result_dtype(image, order, dtype)
    shape = tuple(coordinates.shape[1:])
    result = rt.empty(shaped(tuple(image.shape), shape, axis), made)
    src, margin = sampled(rt, image, axis, order, border)
    dst = rt.adopt(result, made, shape=layout(tuple(result.shape), axis))
    rt.transform.sampling.remap(src, rt.adopt(coordinates), order, border, cval, margin, dst)
    return rt.release(result)


def remap_backward(
    grad: Any,
    image: Any,
    coordinates: Any,
    order: int = 1,
    *,
    mode: str = "constant",
    channel_axis: int | None = None,
) -> RemapGradient:
    """Return the gradients of :func:`remap` for the image and the coordinates.

    Parameters
    ----------
    grad : array of the shape that `remap` returns
        Gradient of a loss with respect to the result.
    image, coordinates, order, mode, channel_axis
        As given to :func:`remap`.

    Returns
    -------
    image : array of the shape of `image`, float32
    coordinates : array of shape (2, H', W'), float32
        Where a coordinate lies on a pixel, the derivative is that of the piece to its right, or
        below. Coordinates outside have the gradient 0 in the modes 'constant' and 'nearest'.

    Raises
    ------
    TypeError
        If an array does not hold real numbers.
    ValueError
        If an array is empty or of a wrong shape, or `order` or `mode` is unknown.

    Notes
    -----
    Gradients of pixels are summed in float64; on a GPU the order is not fixed.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> place = np.array([[[0.0]], [[0.25]]])
    >>> found = cvkern.remap_backward([[1.0]], [[3, 7]], place)
    >>> found.image
    array([[0.75, 0.25]], dtype=float32)
    >>> found.coordinates.ravel()
    array([0., 4.], dtype=float32)
    """
    image, axis, order, border, _ = check_sampled(image, order, mode, 0.0, channel_axis)
    coordinates = _check_coordinates(coordinates)
    wanted = shaped(tuple(image.shape), tuple(coordinates.shape[1:]), axis)
    grad = check_image(grad, ndim=(2, 3), name="grad")
    if tuple(grad.shape) != wanted:
        raise ValueError(f"grad must have shape {wanted}, got {tuple(grad.shape)}")
    rt = runtime(grad, image, coordinates)
    src, margin = sampled(rt, image, axis, order, border, real=True)
    places = rt.adopt(coordinates)
    by_image, by_place = rt.empty(tuple(image.shape)), rt.empty(tuple(coordinates.shape))
    sums = rt.scratch("remap.sums", tuple(src.shape), np.float64)
    rt.transform.sampling.remap_backward(
        rt.adopt(grad, shape=layout(wanted, axis)), src, places, order, border, margin, sums,
        rt.adopt(by_place),
    )  # fmt: skip
    found = rt.adopt(by_image, shape=layout(tuple(image.shape), axis))
    if order == 3:
        reflect = int(border in (Border.REFLECT, Border.NEAREST))
        rt.transform.sampling.prefilter_backward(sums, margin, reflect, found)
    else:
        rt.transform.sampling.narrow(sums, found)
    return RemapGradient(rt.release(by_image), rt.release(by_place))


def check_sampled(
    image: Any, order: int, mode: str, cval: float, channel_axis: int | None
) -> tuple[Any, int | None, int, Border, float]:
    """Check the arguments that all functions share that sample an image."""
    image = check_image(image, ndim=(2, 3))
    axis = check_channel_axis(image.shape, channel_axis)
    if axis == 1:
        raise ValueError(f"channel_axis must be the first or the last, got {channel_axis}")
    order = check_integer(order, "order", 0, 3)
    if order not in ORDERS:
        raise ValueError(f"order must be one of {ORDERS}, got {order}")
    return image, axis, order, check_code(mode, Border, "mode"), check_number(cval, "cval")


def _check_coordinates(coordinates: Any) -> Any:
    coordinates = check_image(coordinates, ndim=(3,), name="coordinates")
    if coordinates.shape[0] != 2:
        raise ValueError(f"coordinates must have shape (2, H, W), got {tuple(coordinates.shape)}")
    return coordinates


def result_dtype(image: Any, order: int, dtype: Any) -> np.dtype:
    """Return the dtype of samples of `image`."""
    if dtype is None:
        byte = order == 0 and library(image).dtype(image) == np.uint8
        return np.dtype(np.uint8 if byte else np.float32)
    try:
        made = np.dtype(dtype)
    except Exception:  # NumPy says of some that they are out of use
        raise TypeError(f"dtype must be float32 or uint8, got {dtype!r}") from None
    if made not in (np.dtype(np.uint8), np.dtype(np.float32)):
        raise TypeError(f"dtype must be float32 or uint8, got {made}")
    return made


def layout(shape: tuple[int, ...], axis: int | None) -> tuple[int, int, int, int]:
    """Return the shape (planes, H, W, channels) that kernels see."""
    if axis is None:
        return (1, shape[0], shape[1], 1)
    if axis == 0:
        return (shape[0], shape[1], shape[2], 1)
    return (1, shape[0], shape[1], shape[2])


def shaped(shape: tuple[int, ...], sides: tuple[int, ...], axis: int | None) -> tuple[int, ...]:
    """Return the shape of an image of other sides and the same channels."""
    if axis is None:
        return tuple(sides)
    return (shape[0], *sides) if axis == 0 else (*sides, shape[2])


def sampled(
    rt: Runtime, image: Any, axis: int | None, order: int, border: Border, real: bool = False
) -> tuple[Any, int]:
    """Return the weighted values, pixels or spline coefficients, and the width of their margin."""
    shape = layout(tuple(image.shape), axis)
    byte = library(image).dtype(image) == np.uint8 and order < 3 and not real
    src = rt.adopt(image, np.uint8 if byte else np.float32, shape=shape)
    if order < 3:
        return src, 0
    margin = SPLINE_PAD if border == Border.NEAREST else 0
    planes, height, width, channels = shape
    wide = (planes, height + 2 * margin, width + 2 * margin, channels)
    coefficients = rt.scratch("transform.coefficients", wide)
    reflect = int(border in (Border.REFLECT, Border.NEAREST))
    rt.transform.sampling.prefilter(src, margin, reflect, coefficients)
    return coefficients, margin
