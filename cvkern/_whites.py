"""The value of white in images, where the caller does not give it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from cvkern._arrays import library
from cvkern._checks import check_positive
from cvkern._runtime import runtime
from cvkern._tape import capturing

BITS = (8, 10, 12, 14, 16, 24, 32, 64)
OVERSHOOT = 1.25  # interpolation of floating-point values may exceed white by this factor


def white_of(image: Any, data_range: float | None = None) -> float:
    """Return the value of white in a checked image: `data_range`, unless that is None.

    White is the largest number of 8-bit integers, and 1 in floating-point images. Wider integers
    often hold fewer bits than they could, such as 12 in uint16: their white is the smallest of
    2^8 - 1, 2^10 - 1, 2^12 - 1 and so on that no value exceeds. Floating-point images with a mean
    above 1 have white there too. In a captured call only the dtype is known.
    """
    if data_range is not None:
        return check_positive(data_range, "data_range")
    dtype = library(image).dtype(image)
    if dtype.itemsize == 1 or capturing():
        return _white_of_dtype(dtype)
    return _white(dtype, *_summary(image))


def white_of_parts(parts: Iterable[Any]) -> float:
    """Return the value of white in an image that is cut into `parts`, at least one."""
    dtypes, seen, sizes = [], [], []
    for part in parts:
        dtypes.append(library(part).dtype(part))
        if dtypes[0].itemsize == 1:
            return white_of(part)
        seen.append(_summary(part))
        sizes.append(math.prod(part.shape))
    largest, means = np.array(seen).T
    with np.errstate(all="ignore"):
        return _white(dtypes[0], float(largest.max()), float(np.average(means, weights=sizes)))


def _white(dtype: np.dtype, largest: float, mean: float) -> float:
    """Return the value of white in an image of `dtype` with this largest value and this mean."""
    below = white = _white_of_dtype(dtype)
    if dtype.kind == "f":
        if not 1 < mean < np.inf:
            return white
        below, largest = np.inf, largest / OVERSHOOT
    return next((w for w in (2.0**bits - 1 for bits in BITS) if largest <= w < below), white)


def _white_of_dtype(dtype: np.dtype) -> float:
    return float(np.iinfo(dtype).max) if dtype.kind in "iu" else 1.0


def white_of_all(images: Any, data_range: float | None = None) -> float:
    """Return the value of white that images have in common."""
    return max(white_of(image, data_range) for image in images)


def _summary(image: Any) -> tuple[float, float]:
    """Return the largest value of an image, and about its mean, which integers do not need."""
    real = library(image).dtype(image).kind == "f"
    values = library(image).contiguous(image, np.dtype(np.float32))
    if not hasattr(values, "max"):  # Warp's arrays
        rt = runtime(image)
        values = rt.to_numpy(rt.adopt(values))
    with np.errstate(all="ignore"):
        return float(values.max()), float(values.mean()) if real else 0.0
