"""Contrast: histograms made even, of a whole image or near each pixel."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from cvkern._arrays import library
from cvkern._checks import (
    FLOAT32_MAX,
    check_depth,
    check_image,
    check_integer,
    check_number,
    check_pair,
)
from cvkern._order import floats_of
from cvkern._runtime import Runtime, runtime
from cvkern.filters.thresholds import count_levels
from cvkern.kernels.codes.color import LEVELS, SLOTS, TONES

MOST = {np.dtype(np.uint8): 255, np.dtype(np.uint16): LEVELS - 1}
CODES = {most: dtype for dtype, most in MOST.items()}


def equalize_hist(image: Any, nbins: int = 256, *, dtype: Any = "float32") -> Any:
    """Map brightness so that each is about as frequent as any other.

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, C)
        uint8, uint16 or floats. All channels are counted together.
    nbins : int, default 256
        Bins between the smallest and the largest value of floats, at least 2; of integers, each
        value has its own.
    dtype : {'float32', 'uint8'}, default 'float32'
        Of the result: with uint8, 255 stands for 1, and values are rounded to the nearest.

    Returns
    -------
    array of the same shape, float32 or uint8
        Share of the pixels that are at most as bright, 0 to 1, with straight lines between bins.

    Raises
    ------
    TypeError
        If `image` does not hold real numbers.
    ValueError
        If it is of another dtype, not finite, or an option is out of range.

    See Also
    --------
    equalize_adapthist : The same near each pixel.

    Notes
    -----
    Equal to :func:`skimage.exposure.equalize_hist`, rounded to float32. Floats are taken as
    float32.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> cvkern.equalize_hist(np.array([[0, 1, 1, 255]], np.uint8))
    array([[0.25, 0.75, 0.75, 1.  ]], dtype=float32)
    """
    image, most, ends = checked(image)
    nbins = check_integer(nbins, "nbins", 2, LEVELS)
    dtype = check_depth(dtype)
    top = 1 if dtype.kind == "f" else 255
    rt = runtime(image)
    shape = tuple(image.shape)
    size = int(np.prod(shape))
    result = rt.empty(shape, dtype)
    if most:
        shares = np.cumsum(count_levels(rt, image)) / size
        given, found = (rt.adopt(image, CODES[most], s) for s in ((size, 1), (size,)))
        table = rt.send("table", _carried(shares * top, dtype))
        rt.color.contrast.look_up(given, found, table, rt.adopt(result, dtype, (size, 1)))
        return rt.release(result)
    values = rt.adopt(image, np.float32, (size,))
    out = rt.adopt(result, dtype, (size,))
    found = out if dtype.kind == "f" else rt.scratch("contrast.shares", (size,))
    edges = _edges(*ends, nbins)
    counts = rt.zeros((nbins,), np.int32)
    rt.color.contrast.count(values, rt.send("edges", edges.astype(np.float64)), counts)
    centres = ((edges[:-1] + edges[1:]) / 2).astype(np.float64)
    heights = np.cumsum(rt.to_numpy(counts), dtype=np.int64) / size * top
    steps = np.diff(centres)
    slopes = np.divide(np.diff(heights), steps, out=np.zeros_like(steps), where=steps > 0)
    rt.color.contrast.curve(
        values, rt.send("centres", centres), rt.send("heights", heights),
        rt.send("slopes", slopes), found,
    )  # fmt: skip
    if dtype.kind != "f":
        rt.filters.depths.narrow(found, out)
    return rt.release(result)


def equalize_adapthist(
    image: Any,
    kernel_size: int | Sequence[int] | None = None,
    clip_limit: float = 0.01,
    nbins: int = 256,
    *,
    dtype: Any = "float32",
) -> Any:
    """Make the histogram around each pixel even, up to a limit of contrast (CLAHE).

    Parameters
    ----------
    image : array of shape (H, W) or (H, W, 3)
        uint8, uint16, or floats in 0 to 1. Of colours, the largest channel is mapped, and the
        others are scaled with it.
    kernel_size : int or (int, int), optional
        Height and width of tiles in pixels; an eighth of the image's when omitted.
    clip_limit : float, default 0.01
        Largest share of a tile's pixels in one bin: what is above goes to the other bins. 0 sets no
        limit.
    nbins : int, default 256
        Bins of a histogram, 2 to 16384.
    dtype : {'float32', 'uint8'}, default 'float32'
        Of the result: with uint8, 255 stands for 1, and values are rounded to the nearest.

    Returns
    -------
    array of the same shape, float32 or uint8
        The largest value is 1 and the smallest 0: of colours, those of the largest channel.

    Raises
    ------
    TypeError
        If `image` does not hold real numbers.
    ValueError
        If it is of another dtype or shape, floats leave 0 to 1, or an option is out of range.

    See Also
    --------
    equalize_hist : One histogram for the whole image.

    Notes
    -----
    Equal to :func:`skimage.exposure.equalize_adapthist`, rounded to float32: brightness is rounded
    to 16 bits and stretched to 2^14 tones; tiles begin at the first pixel, and the image is
    reflected to fill the last. The result is equal in every bit on all devices.

    References
    ----------
    .. [1] K. Zuiderveld, "Contrast limited adaptive histogram equalization", Graphics Gems IV,
       1994.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> ramp = np.tile(np.linspace(0.4, 0.6, 64), (64, 1))
    >>> even = cvkern.equalize_adapthist(ramp)
    >>> float(even.min()), float(even.max())
    (0.0, 1.0)
    """
    image, most, (low, high) = checked(image)
    if len(image.shape) == 3 and image.shape[2] != 3:
        raise ValueError(f"image must have shape (H, W) or (H, W, 3), got {tuple(image.shape)}")
    nbins = check_integer(nbins, "nbins", 2, TONES)
    clip_limit = check_number(clip_limit, "clip_limit", low=0)
    dtype = check_depth(dtype)
    rows, columns = image.shape[:2]
    if kernel_size is None:
        height, width = max(rows // 8, 1), max(columns // 8, 1)
    else:
        height, width = (
            check_integer(k, "kernel_size", 1, LEVELS)
            for k in check_pair(kernel_size, "kernel_size")
        )
    rt = runtime(image)
    size, channels = rows * columns, int(np.prod(image.shape[2:]))
    contrast = rt.color.contrast
    values = rt.adopt(image, CODES.get(most, np.float32), (size, channels))
    top = most or LEVELS - 1
    if most and channels == 1:
        flat, found = (rt.adopt(image, CODES[most], s) for s in ((size,), (rows, columns)))
    else:
        if not most and (low < 0 or high > 1):
            raise ValueError(
                f"image must be in 0 to 1 if it holds floats, got {low + 0.0:g} to {high:g}"
            )
        flat = rt.scratch("contrast.levels", (size,), CODES[top])
        found = flat.reshape((rows, columns))
        contrast.levels(values, float(1 if most else top), flat)
    bins = rt.send("bins", _bins_of_levels(*_extent(rt, flat), top, nbins))

    tall, wide = -(-rows // height), -(-columns // width)
    histograms = rt.zeros((tall, wide, nbins), np.int32)
    contrast.tiles(
        found, bins, rt.send("rows", _reflected(rows, tall * height)),
        rt.send("columns", _reflected(columns, wide * width)), histograms,
    )  # fmt: skip
    pixels, maps = height * width, rt.scratch("contrast.maps", (tall, wide, nbins), np.int32)
    limit = max(int(min(clip_limit, 1) * pixels), 1) if clip_limit > 0 else pixels
    contrast.tone_maps(
        histograms.reshape((tall * wide, nbins)),
        limit,
        (TONES - 1) / pixels,
        maps.reshape((tall * wide, nbins)),
    )
    mixed = rt.scratch("contrast.mixed", (rows, columns), np.uint16)
    contrast.blend(found, bins, maps, rt.send("shares", _shares(height, width)), height, mixed)
    flat = mixed.reshape((size,))
    white = 1 if dtype.kind == "f" else 255
    table = _table(*_extent(rt, flat), white, dtype if channels == 1 else np.dtype(np.float32))
    result = rt.empty(tuple(image.shape), dtype)
    contrast.look_up(
        values, flat, rt.send("table", table), rt.adopt(result, dtype, (size, channels))
    )
    return rt.release(result)


def _extent(rt: Runtime, found: Any) -> tuple[int, int]:
    """Return the smallest and the largest level."""
    ends = rt.zeros((2,), np.int32)
    rt.write(ends, np.array([LEVELS, -1], np.int32))
    rt.color.contrast.extent(found, ends)
    least, most = rt.to_numpy(ends)
    return int(least), int(most)


def checked(image: Any) -> tuple[Any, int, tuple[float, float]]:
    """Return the image, the white of its integers, or 0 of finite floats, and the range.

    The range of floats is from the least to the largest; that of integers is the type's.
    """
    image = check_image(image, ndim=(2, 3))
    dtype = np.dtype(library(image).dtype(image))
    if dtype in MOST:
        return image, MOST[dtype], (0.0, float(MOST[dtype]))
    if dtype.kind != "f":
        raise ValueError(f"image must be of uint8, uint16 or floats, got {dtype}")
    rt = runtime(image)
    values = rt.adopt(image, np.float32, (int(np.prod(image.shape)),))
    low, high, finite = extremes(rt, values)
    if not finite:
        raise ValueError("image must be finite in float32, got some values that are not")
    return image, 0, (low, high)


def extremes(rt: Runtime, values: Any) -> tuple[float, float, bool]:
    """Return the least and the largest finite value, and whether all are finite."""
    keys = rt.scratch("contrast.keys", (SLOTS, 3), np.int64)
    rt.clear(keys)
    rt.color.contrast.survey(values, keys)
    found = rt.to_numpy(keys).max(axis=0)
    ends = floats_of(np.array([2**31 - found[0], found[1] - 2**31], np.int64).astype(np.int32))
    return float(ends[0]), float(ends[1]), not found[2]


def _edges(low: float, high: float, nbins: int) -> np.ndarray:
    """Return the edges of bins from `low` to `high`, as NumPy has them in float32.

    In float64, if float32 cannot hold their span, or tell one from the next.
    """
    ends = np.array([low, high], np.float32)
    wide, largest = ends.astype(np.float64), float(np.abs(ends).max())
    if wide[0] == wide[1]:  # NumPy adds the half too
        wide += np.array([-1, 1]) * max(0.5, largest * 2.0**-30)
    step = (wide[1] - wide[0]) / nbins
    narrow = step >= 2 * np.spacing(np.float32(largest)) and step >= np.finfo(np.float32).tiny
    return np.histogram_bin_edges(
        ends if narrow and largest <= FLOAT32_MAX / 2 else wide, bins=nbins
    )


def _carried(table: np.ndarray, dtype: np.dtype) -> np.ndarray:
    return (table if dtype.kind == "f" else np.rint(table)).astype(dtype)


def _stretched(least: int, most: int, count: int, top: float, step: int = 1) -> np.ndarray:
    """Return the table that maps `least` to 0 and `most` to `top`, for levels a step apart.

    If both are equal, each level stays as it is, up to the limit.
    """
    levels = np.arange(count) * step
    least, most = least * step, most * step
    if least == most:
        return levels.clip(0, top)
    return (levels.clip(least, most) - least) / (most - least) * top


@lru_cache(maxsize=16)
def _bins_of_levels(least: int, most: int, top: int, nbins: int) -> np.ndarray:
    """Return the bin of each level, whose tones are stretched from `least` to `most`."""
    tones = np.rint(_stretched(least, most, top + 1, TONES - 1, (LEVELS - 1) // top))
    return (tones.astype(np.int64) // (1 + TONES // nbins)).astype(np.int32)


@lru_cache(maxsize=16)
def _table(least: int, most: int, white: int, dtype: np.dtype) -> np.ndarray:
    """Return the value of each tone, from 0 for `least` to `white` for `most`."""
    return _carried(_stretched(least, most, TONES, white), dtype)


@lru_cache(maxsize=16)
def _shares(height: int, width: int) -> np.ndarray:
    """Return how far the rows and then the columns of a tile are through it."""
    return np.append(np.arange(height) / height, np.arange(width) / width)


@lru_cache(maxsize=16)
def _reflected(size: int, wanted: int) -> np.ndarray:
    return np.pad(np.arange(size, dtype=np.int32), (0, wanted - size), mode="reflect")
