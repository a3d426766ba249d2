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
MOST_PIXELS = 2**31 - 1
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
        """Product of a patch with itself, before rounding."""
        return SPREAD * SPREAD * self.side * self.side

    @property
    def least(self) -> int:
        """Standard deviation, times the number of pixels, of a patch that is not flat."""
        return int(self.side * self.side * FLAT * WHITE)


class Places(NamedTuple):
    """Where the patches of an image are, by level, row and column, on the host."""

    corners: np.ndarray
    """First pixel of each patch in its pyramid, and the length of its rows, (N, 2) int32."""
    places: np.ndarray
    """Row, column and scale of the centre of each, (N, 3) int32."""
    rows: np.ndarray
    """Place, first patch and last but one of each row of patches, (R, 3) int32."""
    levels: np.ndarray
    """Scale, first row and last but one of each level, (L, 3) int32."""


class Pyramid(NamedTuple):
    """Where the levels of an image lie in an array of pixels, behind the image itself."""

    shapes: tuple[tuple[int, int], ...]
    """Of the image, then of each level."""
    firsts: tuple[int, ...]
    """First pixel of each level, and the number of all."""
    scales: tuple[float, ...]
    """Sizes of objects in each level, in sizes of the model."""


def scale_code(scale: float) -> int:
    """Return a size in steps of 1 / `OCTAVE` octave."""
    return round(OCTAVE * float(np.log2(scale)))


@lru_cache(maxsize=32)
def pyramid_of(shape: tuple[int, int], scales: tuple[float, ...]) -> Pyramid:
    """Return the levels of an image for these sizes of objects.

    A level of the size of the image is the image itself.
    """
    height, width = shape
    shapes, firsts, end = [shape], [], height * width
    for scale in scales:
        own = max(round(height / scale), 1), max(round(width / scale), 1)
        shapes.append(own)
        firsts.append(0 if own == shape else end)
        end += 0 if own == shape else own[0] * own[1]
    if end > MOST_PIXELS:
        raise ValueError(
            f"image must have at most {MOST_PIXELS} pixels at all scales together, got {end}"
        )
    return Pyramid(tuple(shapes), (*firsts, end), scales)


def prepare(rt: Runtime, image: Any, white: float, pyramid: Pyramid) -> Any:
    """Return room for the pixels of a pyramid (P,), for kernels; the image is in it already."""
    height, width = image.shape[:2]
    pixels = rt.scratch("recognition.pyramid", (pyramid.firsts[-1],))
    prepared(rt, image, white, pixels[: height * width].reshape((height, width)))
    return pixels


def fill(rt: Runtime, pixels: Any, pyramid: Pyramid) -> list[Any]:
    """Fill the levels of a pyramid from its image; return them, for kernels."""
    height, width = pyramid.shapes[0]
    gray = pixels[: height * width].reshape((height, width))
    levels = []
    for first, shape in zip(pyramid.firsts, pyramid.shapes[1:], strict=False):
        level = pixels[first : first + shape[0] * shape[1]].reshape(shape)
        if first:
            resample(rt, gray, (1, height, width, 1), "antialiased", level, (1, *shape, 1))
        levels.append(level)
    return levels


def cut(rt: Runtime, pixels: Any, corners: Any, sampling: Sampling) -> Any:
    """Return the patches (N, D) at corners of a pyramid, for kernels."""
    patches = rt.scratch("recognition.patches", (corners.shape[0], sampling.size), np.int8)
    rt.recognition.patches.sample_patches(pixels, corners, sampling.side, sampling.least, patches)
    return patches


@lru_cache(maxsize=32)
def grid_of(pyramid: Pyramid, sampling: Sampling) -> Places:
    """Return where the patches of a grid are."""
    found = []
    for height, width in pyramid.shapes[1:]:
        down, along = (np.arange(0, n - sampling.side + 1, sampling.step) for n in (height, width))
        found.append(np.stack(np.meshgrid(down, along, indexing="ij"), axis=-1).reshape(-1, 2))
    return _listed(found, pyramid, sampling)


def points_of(
    rt: Runtime, levels: list[Any], pyramid: Pyramid, image: Any, white: float, sampling: Sampling
) -> Places:
    """Return where the patches round the points of interest of each level are."""
    half = (sampling.side - 1) / 2
    if sampling.points == "harris":
        pictures = [np.array(rt.to_numpy(level)) for level in levels]
        peaks = [
            corner_peaks(corner_harris(picture, sigma=HARRIS_SIGMA), sampling.step)
            for picture in pictures
        ]
        listed = [np.floor(np.asarray(p) - half + 0.5).astype(np.int64) for p in peaks]
        return _listed(listed, pyramid, sampling)
    found = sift(image, upright=True, data_range=white)
    points, sigmas = (rt.to_numpy(rt.adopt(a)).astype(np.float64) for a in found[:2])
    sizes = np.asarray(pyramid.scales, np.float64)
    wanted = sigmas * PATCH_SIGMAS / sampling.side
    nearest = np.abs(np.log2(wanted)[:, None] - np.log2(sizes)).argmin(axis=1)
    listed = []
    for number, shape in enumerate(pyramid.shapes[1:]):
        zoom = np.array(shape) / np.array(pyramid.shapes[0])
        mine = (points[nearest == number] + 0.5) * zoom - 0.5
        listed.append(np.floor(mine - half + 0.5).astype(np.int64))
    return _listed(listed, pyramid, sampling)


def _listed(found: Sequence[np.ndarray], pyramid: Pyramid, sampling: Sampling) -> Places:
    """Sort the patches of all levels by their first pixels, those that are inside of the image."""
    corners, places, rows, levels = [], [], [], []
    count = lines = 0
    whole = np.array(pyramid.shapes[0])
    given = zip(found, pyramid.shapes[1:], pyramid.firsts, pyramid.scales, strict=False)
    for points, shape, begin, scale in given:
        code = scale_code(scale)
        inside = ((points >= 0) & (points <= np.array(shape) - sampling.side)).all(axis=1)
        points = np.unique(points[inside], axis=0)
        centers = (points + sampling.side / 2) * whole / np.array(shape) - 0.5
        at = np.floor(FINE * centers + 0.5).astype(np.int64)
        of_row, first = np.unique(at[:, 0], return_index=True)
        last = np.r_[first[1:], len(at)]
        pixel = begin + points[:, 0] * shape[1] + points[:, 1]
        corners.append(np.column_stack([pixel, np.full(len(pixel), shape[1])]))
        places.append(np.column_stack([at, np.full(len(at), code)]))
        rows.append(np.column_stack([of_row, first + count, last[: len(first)] + count]))
        levels.append((code, lines, lines + len(of_row)))
        count, lines = count + len(at), lines + len(of_row)
    return Places(
        np.concatenate(corners).astype(np.int32),
        np.concatenate(places).astype(np.int32),
        np.concatenate(rows).astype(np.int32),
        np.array(levels, np.int32),
    )


def find_places(
    rt: Runtime, image: Any, white: float, pixels: Any, pyramid: Pyramid, sampling: Sampling
) -> Places:
    """Return where the patches of an image are; fill its pyramid if that needs the levels."""
    if sampling.points == "grid":
        return grid_of(pyramid, sampling)
    return points_of(rt, fill(rt, pixels, pyramid), pyramid, image, white, sampling)


def sample(
    rt: Runtime, image: Any, white: float, scales: Sequence[float], sampling: Sampling
) -> tuple[Places, Any]:
    """Return the places of the patches of an image, and the patches (N, D) for kernels."""
    pyramid = pyramid_of(tuple(image.shape[:2]), tuple(scales))
    pixels = prepare(rt, image, white, pyramid)
    places = find_places(rt, image, white, pixels, pyramid, sampling)
    if sampling.points == "grid":
        fill(rt, pixels, pyramid)
    return places, cut(rt, pixels, sent(rt, "corners", places.corners, sampling), sampling)


def sent(rt: Runtime, name: str, array: np.ndarray, sampling: Sampling) -> Any:
    """View a host array for kernels; a GPU keeps those of a grid, which never change."""
    if sampling.points == "grid":
        return kept(rt, array)
    return rt.send(f"recognition.{name}", array)
