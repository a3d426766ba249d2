"""Patches of an image at several scales, normalised for kernels."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from cvkern._runtime import Runtime
from cvkern.features import corner_harris, corner_peaks, sift
from cvkern.features._photographs import prepared
from cvkern.kernels.codes.recognition import FINE, OCTAVE, PART, SPREAD, WHITE
from cvkern.recognition._kept import kept
from cvkern.transform.resampling import resample

POINTS = ("grid", "harris", "dog")
LEAST_SIDE, MOST_SIDE = 8, 25
MOST_STEP = 64
FLAT = 0.015  # standard deviation, in parts of white, below which a patch shows nothing
HARRIS_SIGMA = 1.0
PATCH_SIGMAS = 5.0  # side of a patch, in scales of the DoG keypoint that it surrounds


class Sampling(NamedTuple):
    """How patches are taken from an image."""

    side: int
    """Rows and columns of a patch, pixels."""
    points: str
    """Member of `POINTS`."""
    step: int
    """Pixels between points of the grid, or least distance of corners."""

    @property
    def size(self) -> int:
        """Bytes of a patch, with the zeros behind it."""
        return -(-self.side * self.side // PART) * PART

    @property
    def norm(self) -> int:
        """Product of a patch with itself, but for rounding."""
        return SPREAD * SPREAD * self.side * self.side

    @property
    def least(self) -> int:
        """Standard deviation, times the number of pixels, of a patch that is not flat."""
        return int(self.side * self.side * FLAT * WHITE)


class Sampled(NamedTuple):
    """Patches of an image, by level, row and column."""

    places: np.ndarray
    """Row, column and scale of the centre of each, (N, 3) int32."""
    rows: np.ndarray
    """Place, first patch and last but one of each row of patches, (R, 3) int32."""
    levels: np.ndarray
    """Scale, first row and last but one of each level, (L, 3) int32."""
    patches: Any
    """Kernel array (N, D), int8."""
    grid: bool
    """Whether the arrays on the host are those of a grid, and never change."""


def scale_code(scale: float) -> int:
    """Return a size in steps of 1 / `OCTAVE` octave."""
    return round(OCTAVE * float(np.log2(scale)))


def sample(
    rt: Runtime, image: Any, white: float, scales: Sequence[float], sampling: Sampling
) -> Sampled:
    """Sample the patches of an image in which objects have these sizes, in sizes of the model."""
    gray = prepared(rt, image, white)
    height, width = image.shape[:2]
    shapes = tuple(
        tuple(max(round(side / scale), 1) for side in (height, width)) for scale in scales
    )
    codes = tuple(scale_code(scale) for scale in scales)
    zoomed = []
    for number, shape in enumerate(shapes):
        level = gray
        if shape != (height, width):
            level = rt.scratch(f"recognition.level{number}", shape)
            resample(rt, gray, (1, height, width, 1), "antialiased", level, (1, *shape, 1))
        zoomed.append(level)
    if sampling.points == "grid":
        corners, places, rows, levels = _grid(shapes, codes, (height, width), sampling)
    else:
        found = _points(rt, zoomed, scales, image, white, sampling)
        corners, places, rows, levels = _listed(found, shapes, codes, (height, width), sampling)
    patches = rt.scratch("recognition.patches", (len(places), sampling.size), np.int8)
    kernels = rt.recognition.patches
    grid = sampling.points == "grid"
    corners = kept(rt, corners) if grid else rt.send("recognition.corners", corners)
    for level, (_, first, last) in zip(zoomed, levels.tolist(), strict=True):
        if first == last:
            continue
        begin, end = int(rows[first, 1]), int(rows[last - 1, 2])
        some = corners[begin:end], sampling.side, sampling.least, patches[begin:end]
        kernels.sample_patches(level, *some)
    return Sampled(places, rows, levels, patches, grid)


@lru_cache(maxsize=32)
def _grid(
    shapes: tuple[tuple[int, int], ...],
    codes: tuple[int, ...],
    whole: tuple[int, int],
    sampling: Sampling,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the first pixels, places, rows and levels of the patches of a grid."""
    found = []
    for height, width in shapes:
        down, along = (np.arange(0, n - sampling.side + 1, sampling.step) for n in (height, width))
        found.append(np.stack(np.meshgrid(down, along, indexing="ij"), axis=-1).reshape(-1, 2))
    return _listed(found, shapes, codes, whole, sampling)


def _points(
    rt: Runtime,
    zoomed: list[Any],
    scales: Sequence[float],
    image: Any,
    white: float,
    sampling: Sampling,
) -> list[np.ndarray]:
    """Return the first pixels of patches round the points of interest of each level."""
    half = (sampling.side - 1) / 2
    if sampling.points == "harris":
        levels = [np.array(rt.to_numpy(level)) for level in zoomed]
        peaks = [
            corner_peaks(corner_harris(level, sigma=HARRIS_SIGMA), sampling.step)
            for level in levels
        ]
        return [np.floor(np.asarray(p) - half + 0.5).astype(np.int64) for p in peaks]
    found = sift(image, upright=True, data_range=white)
    points, sigmas = (rt.to_numpy(rt.adopt(a)).astype(np.float64) for a in found[:2])
    sizes = np.asarray(scales, np.float64)
    wanted = sigmas * PATCH_SIGMAS / sampling.side
    nearest = np.abs(np.log2(wanted)[:, None] - np.log2(sizes)).argmin(axis=1)
    listed = []
    for number, level in enumerate(zoomed):
        zoom = np.array(level.shape) / np.array(image.shape[:2])
        mine = (points[nearest == number] + 0.5) * zoom - 0.5
        listed.append(np.floor(mine - half + 0.5).astype(np.int64))
    return listed


def _listed(
    found: Sequence[np.ndarray],
    shapes: Sequence[tuple[int, int]],
    codes: Sequence[int],
    whole: tuple[int, int],
    sampling: Sampling,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Sort the patches of all levels, those inside of the image; return also their places."""
    corners, places, rows, levels = [], [], [], []
    count = lines = 0
    for points, shape, code in zip(found, shapes, codes, strict=True):
        inside = ((points >= 0) & (points <= np.array(shape) - sampling.side)).all(axis=1)
        points = np.unique(points[inside], axis=0)
        centers = (points + sampling.side / 2) * np.array(whole) / np.array(shape) - 0.5
        at = np.floor(FINE * centers + 0.5).astype(np.int64)
        of_row, first = np.unique(at[:, 0], return_index=True)
        last = np.r_[first[1:], len(at)]
        corners.append(points)
        places.append(np.column_stack([at, np.full(len(at), code)]))
        rows.append(np.column_stack([of_row, first + count, last[: len(first)] + count]))
        levels.append((code, lines, lines + len(of_row)))
        count, lines = count + len(at), lines + len(of_row)
    return (
        np.concatenate(corners).astype(np.int32),
        np.concatenate(places).astype(np.int32),
        np.concatenate(rows).astype(np.int32),
        np.array(levels, np.int32),
    )
