"""Exposures of one scene fused to a picture, without radiance; and their alignment."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._arrays import library
from cvkern._checks import check_integer, check_number
from cvkern._runtime import Runtime, runtime
from cvkern.kernels.codes.raw import WELL
from cvkern.raw.exposures import stacked

NEAR_MEDIAN = 4  # values this close to the median are not compared


class Alignment(NamedTuple):
    """Exposures that lie above each other, and how they were moved."""

    images: Any
    """The exposures, of the shape and dtype given; beyond a border the last pixels are repeated."""
    shifts: np.ndarray
    """(K, 2) int64: rows and columns that each was moved by."""


def fuse_exposures(
    images: Any,
    *,
    contrast: float = 1.0,
    saturation: float = 1.0,
    exposure: float = 1.0,
) -> Any:
    """Fuse exposures of a scene to one picture in which all of it is well exposed.

    Parameters
    ----------
    images : array of shape (K, H, W) or (K, H, W, 3)
        Exposures, registered: uint8, or floating in 0 to 1. NumPy also takes a sequence of images.
    contrast, saturation, exposure : float, default 1.0
        Exponents of the three measures that an image is weighted by; 0 leaves one out.

    Returns
    -------
    array of shape (H, W) or (H, W, 3), float32
        The picture, in 0 to 1.

    Raises
    ------
    TypeError
        If `images` do not hold real numbers.
    ValueError
        If there are fewer than two images, shapes differ, there are not 3 channels, or an exponent
        is negative.

    See Also
    --------
    merge_exposures : Radiance, where the times of the exposures are known.

    Notes
    -----
    Images are weighted by the size of their Laplacian, the standard deviation of their colours, and
    how near values are to 0.5, and blended band by band [1]_. Bands may add up to more than there
    was: values within 0.05 of 0 and 1 and beyond are bent into the range, by exponentials. Floats
    are limited to 0 to 1 first, and NaN is 0. Equal in every bit on all devices.

    References
    ----------
    .. [1] T. Mertens, J. Kautz and F. Van Reeth, "Exposure fusion", Pacific Graphics 2007.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> light = np.linspace(0, 1, 64) + np.zeros((48, 1))
    >>> images = [np.clip(light * t, 0, 1) for t in (0.5, 1.0, 2.0)]
    >>> fused = cvkern.fuse_exposures(images)
    >>> bool(fused.min() >= 0 and fused.max() <= 1)
    True
    """
    images, shape = stacked(images)
    if shape[3] not in (1, 3):
        raise ValueError(f"images must have 1 or 3 channels, got {shape[3]}")
    powers = [
        check_number(v, n, low=0)
        for v, n in ((contrast, "contrast"), (saturation, "saturation"), (exposure, "exposure"))
    ]
    rt = runtime(images)
    integral = library(images).dtype(images) == np.uint8
    frames = rt.adopt(images, np.uint8 if integral else np.float32, shape)
    scale = 1 / 255 if integral else 1.0
    # exp(-d / (2 WELL^2)) as a power of 2 of the squared distance d.
    powers[2] *= -math.log2(math.e) / (2 * WELL**2)
    count, height, width, channels = shape
    kernels = rt.raw.fusion
    weights = rt.scratch("fusion.weights", shape[:3])
    kernels.weigh(frames, scale, powers[0], powers[1], powers[2], weights)
    levels, planes, sides = [], [], [height, width]
    for n in range(int(math.log2(min(sides)))):
        sides = [(side + 1) // 2 for side in sides]
        levels.append(rt.scratch(f"fusion.level{n}", (count, channels + 1, *sides)))
        planes.append(levels[n].reshape((count * (channels + 1), *sides)))
        if n:
            rt.raw.bands.reduce(planes[n - 1], count * (channels + 1), planes[n])
        else:
            kernels.begin(frames, scale, weights, levels[n])
    coarse = below = rt.scratch("fusion.none", (1, 1, 1))
    for n in reversed(range(len(levels))):
        out = rt.scratch(f"fusion.out{n}", (channels, *levels[n].shape[2:]))
        kernels.blend(levels[n], coarse, int(n + 1 == len(levels)), below, out)
        coarse, below = planes[n], out
    result = rt.empty(tuple(images.shape[1:]))
    out = rt.adopt(result, np.float32, shape[1:])
    kernels.finish(frames, scale, weights, coarse, int(not levels), below, out)
    return rt.release(result)


def align_exposures(images: Any, *, reach: int = 64) -> Alignment:
    """Align exposures that a hand-held camera took, by whole pixels.

    Parameters
    ----------
    images : array of shape (K, H, W) or (K, H, W, 3)
        Exposures, any real dtype. NumPy also takes a sequence of images.
    reach : int, default 64
        Pixels that an image may be off the one in the middle, in each direction.

    Returns
    -------
    Alignment
        Named tuple of the moved `images` and their `shifts`, (0, 0) for the middle one.

    Raises
    ------
    TypeError
        If `images` do not hold real numbers.
    ValueError
        If there are fewer than two images, shapes differ, or `reach` is not in 1 to 1024.

    Notes
    -----
    Median threshold bitmaps [1]_: whether a pixel is above its image's median hardly depends on
    exposure. From coarse to fine, each level tries the nine moves by one pixel, and keeps the one
    with the fewest pixels that differ, the least move on a tie. On the host, equal everywhere.

    References
    ----------
    .. [1] G. Ward, "Fast, robust image registration for compositing high dynamic range photographs
       from hand-held exposures", Journal of Graphics Tools 8, 2003.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> scene = np.random.default_rng(0).random((64, 80))
    >>> images = np.stack([scene, np.roll(scene, (3, -2), (0, 1)) / 2])
    >>> cvkern.align_exposures(images, reach=8).shifts
    array([[ 0,  0],
           [-3,  2]])
    """
    images, shape = stacked(images)
    reach = check_integer(reach, "reach", 1, 1024)
    rt = runtime(images)
    grey = _host(rt, images, shape).mean(axis=3)
    count = len(grey)
    middle = int(np.argsort([float(np.median(g)) for g in grey], kind="stable")[count // 2])
    levels = max(1, min(int(np.ceil(np.log2(reach))), int(np.log2(min(grey.shape[1:]) / 8))) + 1)
    target = _bitmaps(grey[middle], levels)
    shifts = np.zeros((count, 2), np.int64)
    for k in range(count):
        if k != middle:
            shifts[k] = _shift(_bitmaps(grey[k], levels), target)
    moved = np.asarray(rt.to_numpy(rt.adopt(images, library(images).dtype(images))))
    rows, columns = (np.arange(n) for n in shape[1:3])
    aligned = np.stack(
        [
            image[(rows - dy).clip(0, len(rows) - 1)][:, (columns - dx).clip(0, len(columns) - 1)]
            for image, (dy, dx) in zip(moved, shifts, strict=True)
        ]
    )
    return Alignment(rt.give(aligned), shifts)


def _host(rt: Runtime, images: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Return the images on the host as (K, H, W, C) float32."""
    return np.array(rt.to_numpy(rt.adopt(images)), np.float32).reshape(shape)


def _bitmaps(grey: np.ndarray, levels: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return, from fine to coarse, what is above the median, and what is clearly off it."""
    found = []
    noise = NEAR_MEDIAN / 255 * float(np.ptp(grey))
    for _ in range(levels):
        median = np.median(grey)
        found.append((grey > median, np.abs(grey - median) > noise))
        grey = grey[: grey.shape[0] // 2 * 2, : grey.shape[1] // 2 * 2]
        grey = (grey[::2, ::2] + grey[1::2, ::2] + grey[::2, 1::2] + grey[1::2, 1::2]) / 4
    return found


def _shift(
    moving: list[tuple[np.ndarray, np.ndarray]], target: list[tuple[np.ndarray, np.ndarray]]
) -> tuple[int, int]:
    moves = [(y, x) for y in (-1, 0, 1) for x in (-1, 0, 1)]
    moves.sort(key=lambda move: move[0] ** 2 + move[1] ** 2)
    dy = dx = 0
    for (bits, clear), (other, other_clear) in reversed(list(zip(moving, target, strict=True))):
        dy, dx = 2 * dy, 2 * dx
        best, least = (dy, dx), float("inf")
        for y, x in moves:
            here, there = _overlap(bits.shape, dy + y, dx + x)
            off = (bits[there] != other[here]) & clear[there] & other_clear[here]
            share = off.mean() if off.size else float("inf")
            if share < least:
                best, least = (dy + y, dx + x), share
        dy, dx = best
    return dy, dx


def _overlap(shape: tuple[int, ...], dy: int, dx: int) -> tuple[Any, Any]:
    """Return the parts of a fixed image and of one moved by (dy, dx) that lie above each other."""

    def parts(n: int, d: int) -> tuple[slice, slice]:
        return slice(max(d, 0), n + min(d, 0)), slice(max(-d, 0), n + min(-d, 0))

    (row, moved_row), (column, moved_column) = parts(shape[0], dy), parts(shape[1], dx)
    return (row, column), (moved_row, moved_column)
