"""Rank filters. Their results are values of the image, so the dtype is kept."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern._arrays import library
from cvkern._checks import (
    check_axes,
    check_code,
    check_image,
    check_integer,
    check_number,
    check_out,
)
from cvkern._plans import planned
from cvkern._runtime import refuse_capture, runtime
from cvkern._strips import in_strips
from cvkern.filters.linear import image_layout
from cvkern.kernels.codes.filters import Border

MAX_RADIUS = 15
BYTE_RADIUS = 7  # largest window, of 15 x 15 pixels, whose counts fit into bytes


@planned
@in_strips
def median(
    image: Any,
    radius: int = 1,
    *,
    mode: str = "reflect",
    cval: float = 0.0,
    channel_axis: int | None = None,
    batch_axis: int | None = None,
    out: Any = None,
) -> Any:
    """Replace each pixel by the median of the window of ``2 radius + 1`` pixels a side.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C), or a stack of them
        Any real dtype. NaN counts as larger than every number.
    radius : int, default 1
        Half the side of the window: 1 (3 x 3) to 15 (31 x 31). The time grows with the window's
        area.
    mode, channel_axis, batch_axis
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
    order = image.dtype if type(image) is np.ndarray and not image.dtype.isnative else None
    image = check_image(image, ndim=(2, 3) if batch_axis is None else (3, 4))
    axis = check_axes(image.shape, channel_axis, batch_axis)
    radius = check_integer(radius, "radius", 1, MAX_RADIUS)
    border = check_code(mode, Border, "mode")
    lib = library(image)
    dtype = lib.dtype(image)
    check_out(out, image, dtype)
    cval = _value(check_number(cval, "cval"), dtype)
    in_bytes = dtype == np.uint8 and radius <= BYTE_RADIUS
    if axis == 1 or not in_bytes:
        refuse_capture("median of another dtype than uint8, or above 15 x 15")
    axes = axis, batch_axis
    if axis == 1:  # rare: move the channels to the last axis, and back
        last = {"channel_axis": len(image.shape) - 1, "batch_axis": batch_axis}
        swapped = median(lib.swap(image), radius, mode=mode, cval=cval, **last)
        result = lib.contiguous(lib.swap(swapped), dtype)
    elif in_bytes:
        result = _median_of_keys(image, radius, axes, 0, 8, border, int(cval), carrier=dtype)
    elif dtype in _INTEGERS:
        low, bits = _INTEGERS[dtype]
        keys = _median_of_keys(image, radius, axes, low, bits, border, int(cval))
        result = lib.contiguous(keys, dtype)
    elif dtype in (np.float16, np.float32):
        # Bits of a float, as integers; kernels reverse the order of the negative ones.
        floats = lib.view(lib.contiguous(image, np.dtype(np.float32)), np.dtype(np.int32))
        bits = int(np.float32(cval).view(np.int32))
        outside = bits ^ 0x7FFFFFFF if bits < 0 else bits
        keys = _median_of_keys(floats, radius, axes, -(2**31), 32, border, outside, floats=True)
        result = lib.contiguous(lib.view(keys, np.dtype(np.float32)), dtype)
    else:
        # Replace values of wider dtypes by their rank among all values of the image.
        values, ranks, outside = lib.ranks(image, cval)
        bits = max(1, (len(values) - 1).bit_length())
        result = values[_median_of_keys(ranks, radius, axes, 0, bits, border, outside)]
    if out is None:
        return result if order is None else result.astype(order)
    lib.fill(out, result)
    return out


# The smallest value of a dtype, and the number of bits in which its values differ.
_INTEGERS = {  # carried as int32
    np.dtype(name): (low, bits)
    for name, low, bits in (
        ("bool", 0, 1),
        ("uint8", 0, 8),
        ("int8", -(2**7), 8),
        ("uint16", 0, 16),
        ("int16", -(2**15), 16),
        ("int32", -(2**31), 32),
    )
}


def _value(cval: float, dtype: np.dtype) -> float:
    """Return `cval` if the dtype can hold it."""
    if dtype.kind == "f":
        fits = abs(cval) <= float(np.finfo(dtype).max)
    else:
        limits = (0, 1) if dtype.kind == "b" else (np.iinfo(dtype).min, np.iinfo(dtype).max)
        fits = cval == int(cval) and limits[0] <= cval <= limits[1]
    if not fits:
        raise ValueError(f"cval must be a value of {dtype}, got {cval}")
    return cval


def _median_of_keys(
    keys: Any,
    radius: int,
    axes: tuple[int | None, int | None],
    low: int,
    bits: int,
    border: Border,
    cval: int,
    *,
    carrier: Any = np.int32,
    floats: bool = False,
) -> Any:
    """Return the median of integers, or of floats as integer bits, in the dtype of `carrier`."""
    rt = runtime(keys)
    shape = tuple(keys.shape)
    planes, step = image_layout(shape, *axes)
    src = rt.adopt(keys, carrier, planes)
    result = rt.empty(shape, carrier)
    dst = rt.adopt(result, carrier, planes)
    if floats:
        bits_of_floats, src = src, rt.scratch("median.keys", planes, np.int32)
        rt.filters.medians.keys_of_floats(bits_of_floats, src)
    rt.filters.medians.median(src, radius, step, low, bits, border, cval, dst)
    if floats:
        rt.filters.medians.floats_of_keys(dst, dst)
    return rt.release(result)
