"""Oriented FAST corners with binary descriptors: ORB."""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from cvkern._arrays import library
from cvkern._checks import check_flag, check_integer, check_number
from cvkern._runtime import Runtime, runtime
from cvkern._whites import white_of
from cvkern.features._choice import best
from cvkern.features._elementary import cos_sin
from cvkern.features._photographs import (
    as_host,
    check_photograph,
    prepared,
    unmasked,
    warn_of_dark,
)
from cvkern.features.keypoints import Features
from cvkern.kernels.codes.features import (
    BLUR,
    PAIRS,
    PATTERN_PITCH,
    PATTERN_REACH,
    SHARES,
    TURNS,
    WORD,
)
from cvkern.transform.resampling import weights_along

EDGE = PATTERN_REACH + BLUR  # pixels at the border without points
TABLE = Path(__file__).parent / "data" / "orb_pairs.csv"


def orb(
    image: Any,
    max_keypoints: int | None = 500,
    *,
    mask: Any = None,
    spread: bool = False,
    upright: bool = False,
    levels: int = 8,
    downscale: float = 1.2,
    fast_threshold: float = 0.08,
    data_range: float | None = None,
) -> Features:
    """Find corners at several scales and describe them by bits, as ORB does.

    Parameters
    ----------
    image : array of shape (H, W), or a colour photograph (H, W, 3) or (H, W, 4)
        Any real dtype. Colours become the grey ``0.2125 R + 0.7154 G + 0.0721 B``.
        Pixels that are not finite, or beyond 1e15 times white, count as 0.
    max_keypoints : int, optional
        Number of points to keep, shared among the levels by the lengths of their sides; 500 by
        default. None keeps all.
    mask : array of shape (H, W), optional
        Points whose nearest pixel is 0 here are removed before the best are selected.
    spread : bool, default False
        Spread the points of a level over it, by first taking the best of every square of a grid.
    upright : bool, default False
        Set orientations to 0, for cameras that are always upright.
    levels : int, default 8
        Number of image sizes in which corners are found.
    downscale : float, default 1.2
        Ratio of each size to the next smaller one; above 1, at most 4.
    fast_threshold : float, default 0.08
        Least difference between the middle of a circle and 9 contiguous pixels of its 16, all
        brighter or all darker, in parts of `data_range`: at most 1. OpenCV's 20 is 20 / 255.
    data_range : float, optional
        The value of white. By default 255 for bytes and 1 for floating-point images; for wider
        integers, and floating-point images with a mean above 1, the smallest of 2^8 - 1,
        2^10 - 1, 2^12 - 1 and so on that no value exceeds.

    Returns
    -------
    points : array of shape (N, 2), float32
        Rows and columns, in the order of (level, row, column).
    scales : array of shape (N,), float32
        Pixels of `image` per pixel of the level.
    orientations : array of shape (N,), float32
        Radians, from the columns' direction towards the rows': that of the disc's centroid.
    responses : array of shape (N,), float32
        Harris' measure, in parts of its largest possible value.
    descriptors : array of shape (N, 32), uint8
        256 bits, for ``match_descriptors(..., metric="hamming")``.

    Raises
    ------
    TypeError
        If `image` or `mask` does not hold real numbers.
    ValueError
        If `image` is empty or has a wrong shape, `mask` is not of its shape, or an option is out
        of its range.

    Notes
    -----
    Grey values are rounded to 8 bits, and from there on all is decided in integers or in stated
    orders of float32 operations: results have the same bits on every device. The bits compare the
    published pairs, in their order, of the image smoothed as by OpenCV. The pairs are turned in
    steps of 1/64 of a circle. OpenCV turns them by any angle, which changes one bit in 28, so that
    descriptors of the same point in both libraries can be matched. Points themselves differ: other
    libraries make the smaller sizes in other ways, and leave other borders without points.

    References
    ----------
    .. [1] E. Rublee and others, "ORB: an efficient alternative to SIFT or SURF", ICCV 2011.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> square = np.zeros((80, 90))
    >>> square[30:50, 35:60] = 1
    >>> found = cvkern.orb(square, 4, levels=1)
    >>> found.points.shape, found.descriptors.shape
    ((4, 2), (4, 32))
    """
    spread = check_flag(spread, "spread")
    upright = check_flag(upright, "upright")
    image, mask, max_keypoints = check_photograph(image, mask, max_keypoints)
    shape = tuple(image.shape)
    levels = check_integer(levels, "levels", 1, 32)
    downscale = check_number(downscale, "downscale")
    if not 1 < downscale <= 4:
        raise ValueError(f"downscale must be above 1 and at most 4, got {downscale:g}")
    threshold = check_number(fast_threshold, "fast_threshold", low=0)
    if threshold > 1:
        raise ValueError(f"fast_threshold must be at most 1, a part of white, got {threshold:g}")
    white = white_of(image, data_range)
    rt = runtime(image)
    host = None if mask is None else as_host(rt, mask)
    sides, starts, weights = sizes_of(shape[0], shape[1], levels, downscale)
    lengths = np.sqrt([float(a * b) for a, b in sides])
    quotas: list[int | None] = [None] * len(sides)
    if max_keypoints is not None:
        ends = np.floor(np.cumsum(lengths) / lengths.sum() * max_keypoints + 0.5).astype(int)
        quotas = np.diff(np.r_[0, ends]).tolist()
    sizes = [_bytes(rt, image, white)]
    sizes += [rt.scratch(f"orb.level{n}", side, np.uint8) for n, side in enumerate(sides) if n]
    if len(sizes) > 1:
        rt.features.binary.shrink(sizes, rt.constant(starts), rt.constant(weights))
    cells, measures = _corners(rt, sizes, sides, min(int(threshold * 255), 255))
    scales = np.array(shape[:2]) / np.array(sides)
    if host is not None:
        kept = unmasked(_on_image(cells[:, 2:], scales[cells[:, 0]]), host)
        cells, measures = cells[kept], measures[kept]
    if not len(cells):
        warn_of_dark(rt, image, white)
    bounds = np.searchsorted(cells[:, 0], np.arange(len(sides) + 1)).tolist()
    parts = [slice(*bounds[n : n + 2]) for n in range(len(sides))]
    kept = np.concatenate(
        [
            mine.start + best(measures[mine], cells[mine, 2:], side, quota, spread)
            for mine, side, quota in zip(parts, sides, quotas, strict=True)
        ]
    )
    cells, measures = cells[kept], measures[kept]
    angles, descriptors = _described(rt, sizes, cells, upright)
    scales = scales[cells[:, 0]]
    # Sums of 49 products of Sobel derivatives of bytes, of at most 1020 each.
    full = 25.0 * (49 * 1020.0**2) ** 2
    parts = (
        _on_image(cells[:, 2:], scales),
        np.sqrt(scales[:, 0] * scales[:, 1]).astype(np.float32),
        angles,
        (measures / full).astype(np.float32),
        descriptors,
    )
    return Features(*(rt.give(np.ascontiguousarray(p)) for p in parts))


def _bytes(rt: Runtime, image: Any, white: float) -> Any:
    """Return the rounded grey of an image with white as 255, as a kernel array."""
    shape = tuple(image.shape)
    if len(shape) == 2 and white == 255.0 and library(image).dtype(image) == np.uint8:
        return rt.adopt(image, np.uint8)
    rounded = rt.scratch("orb.level0", shape[:2], np.uint8)
    rt.features.binary.round_values(prepared(rt, image, white / 255.0), rounded)
    return rounded


def _corners(
    rt: Runtime, sizes: list[Any], sides: list[tuple[int, int]], threshold: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return size, 1, row and column (N, 4) of all corners, in this order, and their measures."""
    none = np.empty((0, 4), np.int32), np.empty(0, np.int64)
    if min(sides[0]) <= 2 * EDGE:
        return none
    kernels = rt.features.binary
    words = rt.scratch("orb.words", (sum(h * -(-w // WORD) for h, w in sides),), np.int32)
    ends = rt.scratch("orb.ends", (sum(h for h, _ in sides),), np.int32)
    kernels.mark_corners(sizes, threshold, EDGE, words, ends)
    total = int(rt.to_numpy(ends[-1:])[0])
    if not total:
        return none
    cells = rt.scratch("orb.cells", (total, 4), np.int32)
    measures = rt.scratch("orb.measures", (total,), np.int64)
    kernels.list_corners(sizes, words, ends, cells, measures)
    return rt.to_numpy(cells), rt.to_numpy(measures)


def _described(
    rt: Runtime, sizes: list[Any], cells: np.ndarray, upright: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return the directions and the bits of corners."""
    angles = rt.scratch("orb.angles", (len(cells),))
    descriptors = rt.scratch("orb.descriptors", (len(cells), PAIRS // 8), np.uint8)
    if len(cells):
        sent = rt.send("orb.kept", cells)
        rt.features.binary.describe_corners(
            sizes, sent, rt.constant(pattern()), int(upright), angles, descriptors
        )
    return np.array(rt.to_numpy(angles)), np.array(rt.to_numpy(descriptors))


def _on_image(cells: np.ndarray, scale: Any) -> np.ndarray:
    """Map the centres of pixels of a level to the image."""
    return ((cells + 0.5) * scale - 0.5).astype(np.float32)


@lru_cache(maxsize=8)
def sizes_of(
    height: int, width: int, levels: int, downscale: float
) -> tuple[list[tuple[int, int]], np.ndarray, np.ndarray]:
    """Return the sizes of an image, and where the pixels of the smaller ones come from.

    For each row of the second size, then for each column, and so on for all smaller ones: its first
    pixel in the size before, and the weights from there, those of a triangle as wide as two pixels
    of the result, as integers whose sum is SHARES.
    """
    sides = [(round(height / downscale**n), round(width / downscale**n)) for n in range(levels)]
    sides = [s for s in sides if min(s) > 2 * EDGE] or sides[:1]
    parts = [
        weights_along(a, b, "antialiased")
        for old, new in pairwise(sides)
        for a, b in zip(old, new, strict=True)
    ]
    taps = max((np.flatnonzero(w.any(axis=0))[-1] + 1 for _, w in parts), default=1)
    starts = np.concatenate([start for start, _ in parts] or [np.empty(0, np.int32)])
    exact = np.zeros((len(starts), taps))
    end = 0
    for start, weights in parts:
        most = min(taps, weights.shape[1])
        exact[end : end + len(start), :most] = SHARES * weights[:, :most].astype(np.float64)
        end += len(start)
    rounded = np.floor(exact + 0.5).astype(np.int64)
    # The largest weight absorbs the rounding of all.
    rounded[np.arange(end), exact.argmax(axis=1)] += SHARES - rounded.sum(axis=1)
    return sides, starts, rounded.astype(np.uint8)


@lru_cache(maxsize=1)
def pattern() -> np.ndarray:
    """Return the places of the pairs of pixels of each turn: (TURNS, PAIRS, 2), int16."""
    places = np.loadtxt(TABLE, np.float64, delimiter=",", skiprows=1).reshape(PAIRS, 2, 2)
    angles = np.arange(TURNS) * (2 * math.pi / TURNS)
    cos, sin = cos_sin(np.where(angles > math.pi, angles - 2 * math.pi, angles))
    turns = np.array([[sin, cos], [cos, -sin]]).transpose(2, 0, 1)  # (column, row) to (row, column)
    rounded = np.floor(np.einsum("tij,pqj->tpqi", turns, places) + 0.5)
    return np.ascontiguousarray(rounded @ np.array([PATTERN_PITCH, 1.0]), np.int16)
