"""Exposures of one scene fused to a picture, without radiance; and their alignment."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cvkern._arrays import library
from cvkern._checks import check_integer, check_number
from cvkern._runtime import Runtime, runtime
from cvkern.raw.exposures import stacked

WELL = 0.2  # standard deviation of how well a value is exposed, about the middle
KNEE = 0.05  # distance from 0 and 1 at which values are held back
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
    was: values within 0.05 of 0 and 1 and beyond are bent into the range, by exponentials. It is
    made on the host, and equal on all devices.

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
    values = _host(rt, images, shape)
    if library(images).dtype(images) == np.uint8:
        values = values / np.float32(255)
    weights = np.stack([_quality(image, powers) for image in values])
    with np.errstate(over="ignore", invalid="ignore"):  # weights may be infinite
        weights = weights / weights.sum(axis=0)
    levels = 1 + int(np.log2(min(shape[1:3])))
    bands: list[np.ndarray] = []
    for image, weight in zip(values, weights, strict=True):
        for level in range(levels):
            last = level == levels - 1
            small = image if last else _reduced(image)
            band = image if last else image - _expanded(small, image.shape)
            part = band * weight[..., None]
            if level < len(bands):
                bands[level] += part
            else:
                bands.append(part)
            if not last:
                image, weight = small, _reduced(weight[..., None])[..., 0]
    fused = bands[-1]
    for band in reversed(bands[:-1]):
        fused = band + _expanded(fused, band.shape)
    fused = _limited(fused)
    return rt.give(np.ascontiguousarray(fused.reshape(images.shape[1:]), np.float32))


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


@np.errstate(over="ignore", invalid="ignore")  # values may not be finite
def _quality(image: np.ndarray, powers: list[float]) -> np.ndarray:
    """Return the product of the measures of an image, a little above 0."""
    grey = image.mean(axis=2)
    framed = np.pad(grey, 1, mode="reflect" if min(grey.shape) > 1 else "edge")
    sides = framed[:-2, 1:-1] + framed[2:, 1:-1] + framed[1:-1, :-2] + framed[1:-1, 2:]
    quality = np.abs(sides - 4 * grey) ** powers[0]
    if image.shape[2] == 3:
        quality *= image.std(axis=2) ** powers[1]
    well = np.exp(-((image - 0.5) ** 2) / (2 * WELL**2)).prod(axis=2)
    return quality * well ** powers[2] + np.float32(1e-12)


def _reduced(image: np.ndarray) -> np.ndarray:
    """Smooth by the taps, mirrored at the border, and leave out every second row and column."""
    for axis in (0, 1):
        n = image.shape[axis]
        width = [(2, 2) if a == axis else (0, 0) for a in range(image.ndim)]
        framed = np.moveaxis(np.pad(image, width, mode="reflect" if n > 2 else "edge"), axis, 0)
        ends = framed[0:n:2] + framed[4 : n + 4 : 2]
        near = framed[1 : n + 1 : 2] + framed[3 : n + 3 : 2]
        found = (ends + 4 * near + 6 * framed[2 : n + 2 : 2]) * np.float32(1 / 16)
        image = np.moveaxis(found, 0, axis)
    return image


def _expanded(image: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Bring an image to twice the size, by the same taps."""
    for axis in (0, 1):
        x, n = np.moveaxis(image, axis, 0), shape[axis]
        after = x[-2:-1] if n % 2 and len(x) > 1 else x[-1:]  # mirrored at the last of n
        framed = np.concatenate([x[1:2] if len(x) > 1 else x, x, after])
        found = np.empty((n, *x.shape[1:]), np.float32)
        found[::2] = (framed[:-2] + 6 * x + framed[2:]) * np.float32(1 / 8)
        found[1::2] = (x + framed[2:])[: n // 2] * np.float32(1 / 2)
        image = np.moveaxis(found, 0, axis)
    return image


def _limited(fused: np.ndarray) -> np.ndarray:
    """Take values beyond 0 and 1 back, without making two of them equal: softly at either end."""
    fused = np.where(fused < KNEE, KNEE * np.exp(np.minimum(fused / KNEE - 1, 0)), fused)
    over = np.maximum((fused - 1) / KNEE + 1, 0)
    return np.where(over > 0, 1 - KNEE * np.exp(-over), fused)


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
