"""Oriented FAST corners with binary descriptors: ORB."""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import pairwise
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
    sizes = [_bytes(rt, image, white)]
    for n, (old, new) in enumerate(pairwise(sides), 1):
        sizes.append(rt.scratch(f"orb.level{n}", new, np.uint8))
        old, new = (1, *old, 1), (1, *new, 1)
        resample(rt, sizes[-2].reshape(old), old, "antialiased", sizes[-1].reshape(new), new)
    cells, measures = _corners(rt, sizes, sides, min(int(threshold * 255), 255))
    scales = np.array(shape[:2]) / np.array(sides)
    if host is not None:
        kept = unmasked(_on_image(cells[:, 2:], scales[cells[:, 0]]), host)
        cells, measures = cells[kept], measures[kept]
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
        taps = rt.constant(gaussian_taps(SMOOTHING, 0, BLUR / SMOOTHING))
        rt.features.binary.describe_corners(
            sizes, taps, rt.send("orb.kept", cells), rt.constant(pattern()), int(upright), angles,
            descriptors,
        )  # fmt: skip
    return np.array(rt.to_numpy(angles)), np.array(rt.to_numpy(descriptors))


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
