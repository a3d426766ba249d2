"""Oriented FAST corners with binary descriptors: ORB."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

from cvkern._arrays import library
from cvkern._checks import check_flag, check_integer, check_number
from cvkern._runtime import Runtime, runtime
from cvkern.features._choice import best
from cvkern.features._elementary import cos_sin
from cvkern.features._photographs import as_host, check_photograph, prepared, unmasked, white_of
from cvkern.features.keypoints import Features
from cvkern.filters.linear import gaussian_taps
from cvkern.kernels.codes.features import BLUR, DISC, PAIRS, TURNS, WORD
from cvkern.transform.resampling import resample

EDGE = 19  # pixels at the border without points: the disc, and 7 x 7 pixels with their neighbours
SMOOTHING = 2.0  # sigma before pixels are compared
SPREAD = 31 / 5  # sigma of the pattern [Calonder 2010]
SEED = 2463534242


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
        Number of points to keep, shared among the levels by area; 500 by default. None keeps all.
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
        brighter or all darker, in parts of `data_range`.
    data_range : float, optional
        The value of white. By default the largest number of an integer dtype, else 1.

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
    orders of float32 operations: results have the same bits on every device. The pairs that the
    bits compare are not ORB's learnt ones but drawn from a Gaussian, as BRIEF's, by a fixed
    generator (xorshift, seed 2463534242); descriptors of other libraries cannot be matched with
    these.

    References
    ----------
    .. [1] E. Rublee and others, "ORB: an efficient alternative to SIFT or SURF", ICCV 2011.
    .. [2] M. Calonder and others, "BRIEF: binary robust independent elementary features",
       ECCV 2010.

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
    white = white_of(image, data_range)
    rt = runtime(image)
    host = None if mask is None else as_host(rt, mask)
    sides = [
        (round(shape[0] / downscale**n), round(shape[1] / downscale**n)) for n in range(levels)
    ]
    sides = [s for s in sides if min(s) > 2 * EDGE] or sides[:1]
    areas = np.array([a * b for a, b in sides], np.float64)
    quotas: list[int | None] = [None] * len(sides)
    if max_keypoints is not None:
        ends = np.floor(np.cumsum(areas) / areas.sum() * max_keypoints + 0.5).astype(int)
        quotas = np.diff(np.r_[0, ends]).tolist()
    before = _bytes(rt, image, white)
    pairs, taps = rt.constant(pattern()), rt.constant(gaussian_taps(SMOOTHING, 0, BLUR / SMOOTHING))
    limit = min(int(threshold * 255), 255)
    found = []
    for n, (side, quota) in enumerate(zip(sides, quotas, strict=True)):
        level = before
        if n:
            level = rt.scratch(f"orb.level{n}", side, np.uint8)
            old, new = (1, *sides[n - 1], 1), (1, *side, 1)
            resample(rt, before.reshape(old), old, "antialiased", level.reshape(new), new)
        scale = (shape[0] / side[0], shape[1] / side[1])
        cells, measures = _corners(rt, level, side, scale, limit, quota, spread, host)
        found.append((cells, measures, *_described(rt, level, cells, taps, pairs, upright)))
        before = level
    cells, measures, angles, descriptors = (np.concatenate(p) for p in zip(*found, strict=True))
    scales = np.array(shape[:2]) / np.array(sides)
    scales = np.repeat(scales, [len(f[0]) for f in found], axis=0)
    # Sums of 49 products of Sobel derivatives of bytes, of at most 1020 each.
    full = 25.0 * (49 * 1020.0**2) ** 2
    parts = (
        _on_image(cells, scales),
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
    rt: Runtime,
    level: Any,
    side: tuple[int, int],
    scale: tuple[float, float],
    threshold: int,
    quota: int | None,
    spread: bool,
    mask: np.ndarray | None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the pixels of the best corners of one size of the image, and their measures."""
    none = np.empty((0, 2), np.int32), np.empty(0, np.int64)
    height, width = side
    if min(side) <= 2 * EDGE:
        return none
    kernels = rt.features.binary
    words = rt.scratch("orb.words", (1, height, -(-width // WORD)), np.int32)
    counts = rt.scratch("orb.counts", (height,), np.int32)
    kernels.mark_corners(level, threshold, EDGE, words, counts)
    ends = np.cumsum(rt.to_numpy(counts), dtype=np.int64)
    total = int(ends[-1])
    if not total:
        return none
    starts = rt.send("orb.starts", np.r_[0, ends[:-1]].astype(np.int32))
    places = rt.scratch("orb.places", (total,), np.int32)
    measures = rt.scratch("orb.measures", (total,), np.int64)
    kernels.list_corners(level, words, starts, places, measures)
    places, measures = rt.to_numpy(places), rt.to_numpy(measures)
    if mask is not None:
        kept = unmasked(_on_image(_cells(places, width), scale), mask)
        places, measures = places[kept], measures[kept]
    kept = best(measures, _cells(places, width) if spread else places, side, quota, spread)
    return _cells(places[kept], width), measures[kept]


def _described(
    rt: Runtime, level: Any, cells: np.ndarray, taps: Any, pairs: Any, upright: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return the directions and the bits of corners of one size of the image."""
    angles = rt.scratch("orb.angles", (len(cells),))
    descriptors = rt.scratch("orb.descriptors", (len(cells), PAIRS // 8), np.uint8)
    if len(cells):
        rt.features.binary.describe_corners(
            level, taps, rt.send("orb.cells", cells), pairs, int(upright), angles, descriptors
        )
    return np.array(rt.to_numpy(angles)), np.array(rt.to_numpy(descriptors))


def _cells(places: np.ndarray, width: int) -> np.ndarray:
    """Return the rows and columns of places: (N, 2), int32."""
    return np.stack(np.divmod(places, np.int32(width)), axis=1)


def _on_image(cells: np.ndarray, scale: Any) -> np.ndarray:
    """Map the centres of pixels of a level to the image."""
    return ((cells + 0.5) * scale - 0.5).astype(np.float32)


@lru_cache(maxsize=1)
def pattern() -> np.ndarray:
    """Return the pairs of pixels of each turn: (TURNS, PAIRS, 4), int32, rows and columns.

    Coordinates are sums of 12 uniform numbers, nearly normal ones, by Marsaglia's xorshift; pairs
    that reach out of the disc or are closer than 2 pixels are drawn again.
    """
    state, pairs = SEED, []
    while len(pairs) < PAIRS:
        numbers = []
        for _ in range(4):
            total = 0
            for _ in range(12):
                state ^= state << 13 & 0xFFFFFFFF
                state ^= state >> 17
                state ^= state << 5 & 0xFFFFFFFF
                total += state
            numbers.append(SPREAD * (total / 2**32 - 6.0))
        y, x, v, u = numbers
        inside = max(math.hypot(y, x), math.hypot(v, u)) <= DISC - 1
        if inside and math.hypot(y - v, x - u) >= 2:
            pairs.append(numbers)
    places = np.array(pairs).reshape(PAIRS, 2, 2)
    angles = np.arange(TURNS) * (2 * math.pi / TURNS)
    cos, sin = cos_sin(np.where(angles > math.pi, angles - 2 * math.pi, angles))
    turns = np.array([[cos, sin], [-sin, cos]]).transpose(2, 0, 1)  # they turn (row, column)
    turned = np.einsum("tij,pqj->tpqi", turns, places)
    rounded = np.floor(turned + 0.5).astype(np.int32).reshape(TURNS, PAIRS, 4)
    return np.ascontiguousarray(rounded)
