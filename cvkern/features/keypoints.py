"""Keypoints of a scale space, and their descriptors: SIFT."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import check_flag, check_integer, check_number
from cvkern._runtime import Runtime, runtime
from cvkern._whites import white_of
from cvkern.features._choice import Grid, grid_of
from cvkern.features._photographs import check_photograph, prepared, warn_of_dark
from cvkern.filters.linear import gaussian_taps
from cvkern.kernels.codes.features import (
    CELL_SIDE,
    CELLS,
    DIRECTIONS,
    LONGEST,
    MARGIN,
    ORIENTATION_SIGMA,
    PEAKS,
    WORD,
    Limits,
    Points,
    Scales,
    Settled,
)

# Sigma that a photograph is taken to have, in pixels. Lowe has 0.5; with less, more points of sharp
# photographs are found again (measured on graffiti and dogman: 430 against 370 of 1000).
CAMERA_BLUR = 0.2
TRUNCATE = 3.5  # radius of the Gaussians, in standard deviations
SMALLEST = 12  # pixels: the least side of an octave
NUMBERS = CELLS * CELLS * DIRECTIONS  # bytes of a descriptor
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
        Least height of an extremum, times `levels`, in parts of `data_range`: at most 1.
    edge_threshold : float, default 10.0
        Largest ratio of the two principal curvatures: points on straight edges have a large one.
    sigma : float, default 1.6
        Standard deviation of the first level of an octave, in its pixels; above 0.2 (0.4 with
        `double`), at most 4.
    data_range : float, optional
        The value of white. By default 255 for bytes and 1 for floating-point images; for wider
        integers, and floating-point images with a mean above 1, the smallest of 2^8 - 1,
        2^10 - 1, 2^12 - 1 and so on that no value exceeds.

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
    if contrast > 1:
        raise ValueError(f"contrast_threshold must be at most 1, a part of white, got {contrast:g}")
    ratio = check_number(edge_threshold, "edge_threshold", low=1.0)
    sigma = check_number(sigma, "sigma")
    least = CAMERA_BLUR * (2 if double else 1)
    if not least < sigma <= LARGEST_SIGMA:
        raise ValueError(f"sigma must be in ({least:g}, {LARGEST_SIGMA:g}], got {sigma:g}")
    white = white_of(image, data_range)
    rt = runtime(image)
    octaves = _scale_space(rt, image, white, double, levels, sigma)
    limits = Limits(
        float(np.float32(0.5 * (contrast / levels))), contrast / levels, (ratio + 1) ** 2 / ratio
    )
    scales = Scales(sigma, levels, 0.5 if double else 1.0)
    grid = grid_of(shape[:2], max_keypoints if spread else None)
    found = _candidates(rt, octaves, limits, _mask_for(rt, mask, shape[:2]), grid, scales.step)
    count = 0 if found is None else found.cells.shape[0]
    room = count if max_keypoints is None else min(count, max_keypoints)
    if found is None or not room:
        if not count:
            warn_of_dark(rt, image, white)
        none = np.zeros(0, np.float32)
        empty = none.reshape(0, 2), none, none, none, np.zeros((0, NUMBERS), np.uint8)
        return Features(*map(rt.give, empty))
    # The host need not know how many points there are until all are chosen.
    chosen, number = _chosen(rt, found.values, found.squares, grid, room, "points")
    bins, counts = _orientations(rt, octaves, found, chosen, number, scales, upright)
    every = (PEAKS * room,)
    values, squares = (rt.scratch(f"sift.{n}_of", every, np.int32) for n in ("values", "squares"))
    rt.features.keypoints.windows.repeat(found, chosen, number, counts, values, squares)
    most = every[0] if max_keypoints is None else min(every[0], max_keypoints)
    places, number = _chosen(rt, values, squares, grid, most, "places")
    last = int(rt.to_numpy(number)[0])
    return _described(rt, octaves, found, chosen, places, bins, scales, last, root)


def _scale_space(
    rt: Runtime, image: Any, white: float, double: bool, levels: int, sigma: float
) -> list[Any]:
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
    octaves = []
    # Each octave halves the sides, so there are at most 17.
    while not octaves or min(height, width) >= SMALLEST:
        octaves.append(rt.scratch(f"sift.octave{len(octaves)}", (levels + 3, height, width)))
        height, width = height // 2, width // 2
    taps = [rt.constant(gaussian_taps(s, 0, TRUNCATE)) for s in extra]
    kernels.fill_octaves(first, taps, octaves)
    return octaves


def _mask_for(rt: Runtime, mask: Any, shape: tuple[int, ...]) -> Any:
    """Return a mask for kernels; without one, a single pixel that is set stands for all."""
    if mask is None:
        return rt.constant(np.ones((1, 1), np.uint8))
    if isinstance(mask, (np.ndarray, list, tuple)):
        return rt.send("sift.mask", (np.asarray(mask) != 0).astype(np.uint8))
    return rt.adopt_mask(mask)


def _candidates(
    rt: Runtime, octaves: list[Any], limits: Limits, mask: Any, grid: Grid, step: float
) -> Points | None:
    """Return all points of the scale space, in the order of octave, level, row and column."""
    kernels = rt.features.keypoints
    shapes = np.array([octave.shape for octave in octaves], np.int64)
    rows = (shapes[:, 0] - 3) * shapes[:, 1]
    words = rt.scratch("sift.words", (int((rows * -(-shapes[:, 2] // WORD)).sum()),), np.int32)
    ends = rt.scratch("sift.ends", (int(rows.sum()),), np.int32)
    kernels.extrema.mark_keypoints(octaves, limits, MARGIN, words, ends)
    total = int(rt.to_numpy(ends[-1:])[0])
    if not total:
        return None
    found = Points(
        rt.scratch("sift.cells", (total, 4), np.int32),
        rt.scratch("sift.offsets", (total, 4)),
        rt.scratch("sift.points", (total, 2)),
        rt.scratch("sift.values", (total,), np.int32),
        rt.scratch("sift.squares", (total,), np.int32),
    )
    kernels.extrema.list_keypoints(octaves, words, ends, found.cells)
    refine = kernels.refinement.refine
    refine(octaves, limits.contrast, limits.edge, MARGIN, found.offsets, found.cells)
    kernels.selection.place(
        found.cells, found.offsets, step, mask, grid.side, grid.across, *found[2:]
    )
    return found


def _chosen(
    rt: Runtime, values: Any, squares: Any, grid: Grid, most: int, name: str
) -> tuple[Any, Any]:
    """Return the places of at most `most` points of the largest values, and their number."""
    kernels = rt.features.keypoints.selection
    chosen = rt.scratch(f"sift.chosen_{name}", (most,), np.int32)
    number = rt.scratch(f"sift.number_of_{name}", (1,), np.int32)
    ranked = grid.squares > 1 and most < values.shape[0]
    ranks = values
    if ranked:
        ranks = rt.scratch("sift.ranks", values.shape, np.int32)
        kernels.rank(values, squares, grid.squares, ranks)
    kernels.choose(values, ranks, int(ranked), number, chosen)
    return chosen, number


def _orientations(
    rt: Runtime,
    octaves: list[Any],
    found: Points,
    chosen: Any,
    number: Any,
    scales: Scales,
    upright: bool,
) -> tuple[Any, Any]:
    """Return the directions (M, PEAKS) of each chosen point, in bins, and their numbers."""
    room = chosen.shape[0]
    if upright:
        bins, counts = np.zeros((room, PEAKS), np.float32), np.ones(room, np.int32)
        return rt.send("sift.angles", bins), rt.send("sift.peaks", counts)
    windows = rt.scratch("sift.windows", (room, 5), np.int32)
    spreads = rt.scratch("sift.spreads", (room,))
    rt.features.keypoints.windows.aim(found, chosen, number, scales, windows, spreads)
    widest = ORIENTATION_SIGMA * _widest(scales)
    bins = rt.scratch("sift.angles", (room, PEAKS))
    counts = rt.scratch("sift.peaks", (room,), np.int32)
    one = _one(2 * math.pi * widest**2)
    rt.features.keypoints.descriptors.orient(octaves, windows, spreads, one, bins, counts)
    return bins, counts


def _described(
    rt: Runtime,
    octaves: list[Any],
    found: Points,
    chosen: Any,
    places: Any,
    bins: Any,
    scales: Scales,
    count: int,
    root: bool,
) -> Features:
    """Describe `count` points with their orientations; the results are arrays of the caller's."""
    results = [
        rt.empty(shape, dtype)
        for shape, dtype in (
            ((count, 2), np.float32), ((count,), np.float32), ((count,), np.float32),
            ((count,), np.float32), ((count, NUMBERS), np.uint8),
        )
    ]  # fmt: skip
    if count:
        *lists, descriptors = (
            rt.adopt(a, np.uint8 if i == 4 else np.float32) for i, a in enumerate(results)
        )
        settled = Settled(
            rt.scratch("sift.windows", (count, 5), np.int32),
            rt.scratch("sift.turns", (count, 4)),
            *lists,
        )
        kernels = rt.features.keypoints
        kernels.windows.settle(found, chosen, places, bins, scales, settled)
        one = _one((CELL_SIDE * _widest(scales)) ** 2)
        kernels.descriptors.describe(
            octaves, settled.windows, settled.turns, one, int(root), descriptors
        )
    return Features(*map(rt.release, results))


def _widest(scales: Scales) -> float:
    """Return the largest scale of a point, in pixels of its octave."""
    return scales.sigma * 2 ** ((scales.levels + 1) / scales.levels)


def _one(weight: float) -> float:
    """Return the power of two that contributions are counted in: no sum passes 2^31."""
    return 2.0 ** math.floor(math.log2(2**31 / (1.25 * LONGEST * weight)))
