"""Resizing of images."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from cvkern._arrays import library
from cvkern._checks import check_choice, check_flag, check_image, check_sides
from cvkern._plans import planned
from cvkern._runtime import Runtime, runtime
from cvkern.transform.sampling import check_sampled, layout, result_dtype, shaped

METHODS = ("linear", "area")


@planned
def resize(
    image: Any,
    shape: Sequence[int],
    *,
    method: str = "linear",
    antialias: bool = True,
    channel_axis: int | None = None,
    dtype: Any = None,
) -> Any:
    """Resize an image.

    Parameters
    ----------
    image : array of shape (H, W), (H, W, C) or (C, H, W)
        Any real dtype.
    shape : (int, int)
        Height and width of the result. The edges of both images coincide, so that pixel i of
        n shows the coordinate ``(i + 0.5) H / n - 0.5``.
    method : {'linear', 'area'}, default 'linear'
        'linear': a triangle of two pixels, repeated at the borders. 'area': the mean over the
        area that a pixel of the result covers.
    antialias : bool, default True
        Along an axis that shrinks, make the triangle as wide as two pixels of the result.
    channel_axis : int, optional
        Axis of the channels, the first or the last; needed for 3-D images.
    dtype : dtype, optional
        float32 (the default), or uint8: rounded (halves up) and cut off at 0 and 255.

    Returns
    -------
    array of shape (H', W'), (H', W', C) or (C, H', W'), float32 or uint8

    Raises
    ------
    TypeError
        If `image` does not hold real numbers, or `dtype` is neither float32 nor uint8.
    ValueError
        If `image` is empty or of a wrong rank, `shape` is not of two sides of at most 65536, or
        `method` is unknown.

    Notes
    -----
    With `antialias`, 'linear' is the filter BILINEAR of Pillow; without, ``cv2.INTER_LINEAR``.
    'area' is ``cv2.INTER_AREA`` of an image that shrinks.

    Examples
    --------
    >>> import cvkern
    >>> cvkern.resize([[0, 2, 4, 6]], (1, 2), method="area")
    array([[1., 5.]], dtype=float32)
    """
    antialias = check_flag(antialias, "antialias")
    check_choice(method, METHODS, "method")
    sides = check_sides(shape, "shape")
    image, axis, *_ = check_sampled(image, 1, "nearest", 0.0, channel_axis)
    old = tuple(image.shape)
    rt = runtime(image)
    made = result_dtype(image, 1, dtype)
    result = rt.empty(shaped(old, sides, axis), made)
    byte = library(image).dtype(image) == np.uint8
    src = rt.adopt(image, np.uint8 if byte else np.float32, shape=layout(old, axis))
    rule = method if method == "area" else "antialiased" if antialias else "linear"
    dst = rt.adopt(result, made, shape=layout(tuple(result.shape), axis))
    resample(rt, src, layout(old, axis), rule, dst, layout(tuple(result.shape), axis))
    return rt.release(result)


def resample(
    rt: Runtime,
    src: Any,
    old: tuple[int, int, int, int],
    rule: str,
    dst: Any,
    new: tuple[int, int, int, int],
) -> None:
    """Resize a kernel array (P, H, W, C), down the rows first, then along the columns."""
    (tops, down), (starts, along) = (
        tuple(rt.constant(a) for a in weights_along(n, m, rule))
        for n, m in zip(old[1:3], new[1:3], strict=True)
    )
    rt.transform.resampling.resample(src.reshape(old), tops, down, starts, along, dst.reshape(new))


@lru_cache(maxsize=64)
def weights_along(size: int, count: int, rule: str) -> tuple[np.ndarray, np.ndarray]:
    """Return, for each of `count` pixels, its first pixel of `size` and the weights from there."""
    scale = size / count
    if rule == "area":
        low = np.arange(count) * scale
        start = np.floor(low + 1e-9).astype(np.int64)
        reach = math.ceil(scale) + 1
        pixel = start[:, None] + np.arange(reach)
        covered = np.minimum(pixel + 1, (low + scale)[:, None]) - np.maximum(pixel, low[:, None])
        weights = np.where(pixel < size, covered.clip(0), 0.0)
        weights[weights < 1e-7 * scale] = 0.0
    else:
        wide = max(scale, 1.0) if rule == "antialiased" else 1.0
        center = (np.arange(count) + 0.5) * scale - 0.5
        if rule == "linear":
            center = center.clip(0, size - 1)
        start = (np.floor(center - wide).astype(np.int64) + 1).clip(0, size - 1)
        reach = math.ceil(2 * wide) + 1
        pixel = start[:, None] + np.arange(reach)
        weights = (1 - np.abs(pixel - center[:, None]) / wide).clip(0)
        weights = np.where(pixel < size, weights, 0.0)
    weights /= weights.sum(axis=1, keepdims=True)
    weights = weights[:, : int(np.nonzero(weights.any(axis=0))[0][-1]) + 1]
    return start.astype(np.int32), np.ascontiguousarray(weights, np.float32)


def check_pyramid(image: Any, channel_axis: int | None) -> tuple[Any, int | None]:
    """Check an image of a pyramid."""
    image, axis, *_ = check_sampled(image, 1, "reflect", 0.0, channel_axis)
    return check_image(image, ndim=(2, 3)), axis
