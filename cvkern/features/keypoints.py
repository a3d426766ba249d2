"""Keypoints of a scale space, and their descriptors: SIFT."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import check_flag, check_integer, check_number
from cvkern._runtime import Runtime, runtime
from cvkern.features._choice import best
from cvkern.features._elementary import cos_sin, exp2
from cvkern.features._photographs import as_host, check_photograph, prepared, unmasked, white_of
from cvkern.filters.linear import gaussian_taps
from cvkern.kernels.codes.features import (
    BINS,
    CELLS,
    LONGEST,
    MARGIN,
    PEAKS,
    REACH,
    WORD,
)

# Sigma that a photograph is taken to have, in pixels. Lowe has 0.5; with less, more points of sharp
# photographs are found again (measured on graffiti and dogman: 430 against 370 of 1000).
CAMERA_BLUR = 0.2
TRUNCATE = 3.5  # radius of the Gaussians, in standard deviations
SMALLEST = 12  # pixels: the least side of an octave
ORIENTATION_SIGMA = 1.5  # sigma of the window of an orientation, in scales of the point
CELL_SIDE = 3.0  # side of a cell of a descriptor, in scales of the point
LARGEST_SIGMA = 4.0
LEAST_CONTRAST = 1e-4  # noise of a byte has more


class Features(NamedTuple):
    """Keypoints of an image with their descriptors.

    `points` (N, 2) float32 are rows and columns; `scales` (N,) float32 the sigma of the Gaussian
    under each, in pixels; `orientations` (N,) float32 in radians, in (-pi, pi], from the direction
    of the columns towards that of the rows (clockwise on the screen); `responses` (N,) float32 say
    how strong a point is; `descriptors` (N, D) uint8 are compared to find it.
    """

    points: Any
    scales: Any
    orientations: Any
    responses: Any
    descriptors: Any


class _Octaves(NamedTuple):
    """A scale space: the levels of each octave for kernels, and pixels of the image per pixel."""

    levels: list[Any]
    steps: np.ndarray


def sift(
    image: Any,
    max_keypoints: int | None = None,
    *,
    mask: Any = None,
    spread: bool = False,
    root: bool = True,
    upright: bool = False,
    double: bool = True,
    levels: int = 3,
    contrast_threshold: float = 0.04,
    edge_threshold: float = 10.0,
    sigma: float = 1.6,
    data_range: float | None = None,
) -> Features:
    """Find keypoints at all scales and describe them, by SIFT.

    Parameters
    ----------
    image : array of shape (H, W), or a colour photograph (H, W, 3) or (H, W, 4)
        Any real dtype. Colours become the grey ``0.2125 R + 0.7154 G + 0.0721 B``.
        Pixels that are not finite, or beyond 1e15 times white, count as 0.
    max_keypoints : int, optional
        Number of points to keep: those with the largest response; ties go to the first.
    mask : array of shape (H, W), optional
        Points whose nearest pixel is 0 here are removed before the best are selected.
    spread : bool, default False
        With `max_keypoints`: spread the points over the image, by first taking the best of every
        square of a grid.
    root : bool, default True
        RootSIFT: the square roots of descriptors whose sum is 1, so that the Euclidean distance
        is Hellinger's. False: SIFT.
    upright : bool, default False
        Set orientations to 0, for cameras that are always upright.
    double : bool, default True
        Start with the image at twice its size. This takes about four times the time and gives about
        four times the points.
    levels : int, default 3
        Number of levels with extrema in an octave, which is a doubling of the scale.
    contrast_threshold : float, default 0.04
        Least height of an extremum, times `levels`, in parts of `data_range`.
    edge_threshold : float, default 10.0
        Largest ratio of the two principal curvatures: points on straight edges have a large one.
    sigma : float, default 1.6
        Standard deviation of the first level of an octave, in its pixels; above 0.2 (0.4 with
        `double`), at most 4.
    data_range : float, optional
        The value of white. By default the largest number of an integer dtype, else 1.

    Returns
    -------
    points : array of shape (N, 2), float32
        Rows and columns; pixel centres are integers. In the order of (octave, level, row, column)
        of the pixel of an octave, then of the height of the orientation's peak.
    scales : array of shape (N,), float32
        Sigma in pixels of `image`.
    orientations : array of shape (N,), float32
        Radians, from the columns' direction towards the rows'. A point with several strong
        directions, up to four, comes once with each.
    responses : array of shape (N,), float32
        Height of the extremum in parts of `data_range`.
    descriptors : array of shape (N, 128), uint8
        16 cells row by row, of 8 directions each.

    Raises
    ------
    TypeError
        If `image` or `mask` does not hold real numbers.
    ValueError
        If `image` is empty or has a wrong shape, `mask` is not of its shape, or an option is out
        of its range.

    Notes
    -----
    All decisions are made in integers or in stated orders of float64 and float32 operations: the
    number of points, their order and all bits are the same on every device and in every run. They
    are not OpenCV's bits, which depend on the processor. Pixels are taken for the whole plane as
    ``cv2.SIFT_create(enable_precise_upscale=True)`` does.

    References
    ----------
    .. [1] D. Lowe, "Distinctive image features from scale-invariant keypoints", IJCV 60(2), 2004.
    .. [2] R. Arandjelovic and A. Zisserman, "Three things everyone should know to improve object
       retrieval", CVPR 2012.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> y, x = np.mgrid[:64, :64]
    >>> blob = np.exp(-((y - 30) ** 2 + (x - 22) ** 2) / (2 * 5.0**2))
    >>> found = cvkern.sift(blob)
    >>> found.points.round(1)[0], found.descriptors.shape[1]
    (array([30., 22.], dtype=float32), 128)
    """
    spread = check_flag(spread, "spread")
    root = check_flag(root, "root")
    upright = check_flag(upright, "upright")
    double = check_flag(double, "double")
    image, mask, max_keypoints = check_photograph(image, mask, max_keypoints)
    shape = tuple(image.shape)
    levels = check_integer(levels, "levels", 1, 8)
    contrast = check_number(contrast_threshold, "contrast_threshold", low=LEAST_CONTRAST)
    ratio = check_number(edge_threshold, "edge_threshold", low=1.0)
    sigma = check_number(sigma, "sigma")
    least = CAMERA_BLUR * (2 if double else 1)
    if not least < sigma <= LARGEST_SIGMA:
        raise ValueError(f"sigma must be in ({least:g}, {LARGEST_SIGMA:g}], got {sigma:g}")
    white = white_of(image, data_range)
    rt = runtime(image)
    octaves = _scale_space(rt, image, white, double, levels, sigma)
    limit = contrast / levels, (ratio + 1) ** 2 / ratio
    offsets, cells = _extrema(rt, octaves.levels, *limit)
    steps = octaves.steps[cells[:, 0]]
    points = (cells[:, 2:] + offsets[:, :2].astype(np.float64)) * steps[:, None]
    points = points.astype(np.float32)
    kept = np.arange(len(points))
    if mask is not None:
        kept = unmasked(points, as_host(rt, mask))
    kept = kept[best(offsets[kept, 3], points[kept], shape[:2], max_keypoints, spread)]
    offsets, cells, points, steps = (a[kept] for a in (offsets, cells, points, steps))
    # Scale in pixels of the octave; levels are counted from 1, as extrema have them.
    scales = (sigma * exp2((cells[:, 1] + offsets[:, 2].astype(np.float64)) / levels)).astype(
        np.float32
    )
    source, bins = _orientations(rt, octaves.levels, cells, scales, upright, sigma, levels)
    if max_keypoints is not None and len(source) > max_keypoints:
        chosen = best(offsets[source, 3], points[source], shape[:2], max_keypoints, spread)
        source, bins = source[chosen], bins[chosen]
    turned = np.where(bins >= BINS / 2 + 1e-9, bins - BINS, bins)
    angles = (turned * (2 * math.pi / BINS)).astype(np.float32)
    descriptors = _descriptors(
        rt, octaves.levels, cells[source], scales[source], angles, root, sigma, levels
    )
    return Features(
        rt.give(points[source]),
        rt.give((scales[source] * steps[source]).astype(np.float32)),
        rt.give(angles),
        rt.give(np.ascontiguousarray(offsets[source, 3])),
        descriptors,
    )


def _scale_space(
    rt: Runtime, image: Any, white: float, double: bool, levels: int, sigma: float
) -> _Octaves:
    """Smooth and shrink the image; the octaves stay in memory until all points are described."""
    kernels = rt.features.keypoints.extrema
    first = prepared(rt, image, white)
    height, width = image.shape[:2]
    step = 1.0
    if double:
        height, width, step = 2 * height, 2 * width, 0.5
        larger = rt.scratch("sift.double", (height, width))
        kernels.double(first, larger)
        first = larger
    before = CAMERA_BLUR / step
    sigmas = sigma * 2.0 ** (np.arange(levels + 3) / levels)
    extra = [math.sqrt(sigma**2 - before**2)]
    extra += [math.sqrt(sigmas[i + 1] ** 2 - sigmas[i] ** 2) for i in range(levels + 2)]
    octaves, steps = [], []
    # Each octave halves the sides, so there are at most 17.
    while not octaves or min(height, width) >= SMALLEST:
        octaves.append(rt.scratch(f"sift.octave{len(octaves)}", (levels + 3, height, width)))
        steps.append(step)
        height, width, step = height // 2, width // 2, 2 * step
    taps = [rt.constant(gaussian_taps(s, 0, TRUNCATE)) for s in extra]
    kernels.fill_octaves(first, taps, octaves)
    return _Octaves(octaves, np.array(steps))


def _extrema(
    rt: Runtime, octaves: list[Any], contrast: float, edge: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return offsets (N, 4) and cells (N, 4): octave, level, row and column, in this order."""
    kernels = rt.features.keypoints
    shapes = np.array([octave.shape for octave in octaves], np.int64)
    rows = (shapes[:, 0] - 3) * shapes[:, 1]
    words = rt.scratch("sift.words", (int((rows * -(-shapes[:, 2] // WORD)).sum()),), np.int32)
    ends = rt.scratch("sift.ends", (int(rows.sum()),), np.int32)
    threshold = float(np.float32(0.5 * contrast))
    kernels.extrema.mark_extrema(octaves, threshold, MARGIN, words, ends)
    total = int(rt.to_numpy(ends[-1:])[0])
    if not total:
        return np.empty((0, 4), np.float32), np.empty((0, 4), np.int32)
    offsets = rt.scratch("sift.offsets", (total, 4))
    cells = rt.scratch("sift.cells", (total, 4), np.int32)
    kernels.extrema.list_extrema(octaves, words, ends, cells)
    kernels.refinement.refine(octaves, contrast, edge, MARGIN, offsets, cells)
    offsets, cells = rt.to_numpy(offsets), rt.to_numpy(cells)
    kept = np.flatnonzero(cells[:, 0] >= 0)
    offsets, cells = offsets[kept], cells[kept]
    # Extrema that moved to one pixel are one; the order is that of the pixels.
    pixels = np.cumsum(shapes.prod(axis=1)) - shapes.prod(axis=1)
    octave, level, row, column = cells.T
    _, height, width = shapes.T
    key = pixels[octave] + (level * height[octave] + row) * width[octave] + column
    _, one_each = np.unique(key, return_index=True)
    return offsets[one_each], cells[one_each]


def _orientations(
    rt: Runtime,
    octaves: list[Any],
    cells: np.ndarray,
    scales: np.ndarray,
    upright: bool,
    sigma: float,
    levels: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the point and the direction, in bins, of each orientation of each point."""
    if upright or not len(cells):
        return np.arange(len(cells)), np.zeros(len(cells))
    size = ORIENTATION_SIGMA * scales.astype(np.float64)
    radius = np.minimum(np.floor(3 * size + 0.5), REACH).astype(np.int32)
    windows = rt.send("sift.windows", np.column_stack((cells, radius)).astype(np.int32))
    spreads = rt.send("sift.spreads", (1 / (2 * size * size)).astype(np.float32))
    widest = ORIENTATION_SIGMA * sigma * 2 ** ((levels + 1) / levels)
    one = _one(2 * math.pi * widest**2)
    angles = rt.scratch("sift.angles", (len(cells), PEAKS))
    counts = rt.scratch("sift.peaks", (len(cells),), np.int32)
    rt.features.keypoints.descriptors.orient(octaves, windows, spreads, one, angles, counts)
    there = np.arange(PEAKS) < rt.to_numpy(counts)[:, None]
    source = np.repeat(np.arange(len(cells)), there.sum(axis=1))
    return source, rt.to_numpy(angles)[there].astype(np.float64)


def _descriptors(
    rt: Runtime,
    octaves: list[Any],
    cells: np.ndarray,
    scales: np.ndarray,
    angles: np.ndarray,
    root: bool,
    sigma: float,
    levels: int,
) -> Any:
    """Describe each point; the result is an array of the caller's."""
    side = CELL_SIDE * scales.astype(np.float64)
    half = side * math.sqrt(2) * (CELLS + 1) / 2
    radius = np.minimum(np.floor(half + 0.5), REACH).astype(np.int32)
    cosine, sine = cos_sin(angles.astype(np.float64))
    # The Gaussian of the window has half the width of the cells.
    spread = 1 / (2 * (CELLS / 2 * side) ** 2)
    one = _one((CELL_SIDE * sigma * 2 ** ((levels + 1) / levels)) ** 2)
    numbers = CELLS * CELLS * 8
    result = rt.empty((len(cells), numbers), np.uint8)
    if not len(cells):
        return rt.release(result)
    whole = rt.adopt(result, np.uint8)
    windows = rt.send("sift.windows", np.column_stack((cells, radius)).astype(np.int32))
    turns = np.column_stack((cosine / side, sine / side, angles, spread))
    turns = rt.send("sift.turns", turns.astype(np.float32))
    rt.features.keypoints.descriptors.describe(octaves, windows, turns, one, int(root), whole)
    return rt.release(result)


def _one(weight: float) -> float:
    """Return the power of two that contributions are counted in: no sum passes 2^31."""
    return 2.0 ** math.floor(math.log2(2**31 / (1.25 * LONGEST * weight)))
