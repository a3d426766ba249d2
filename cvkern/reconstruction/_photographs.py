"""Photographs of a reconstruction: their keypoints, and the lenses that they share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from cvkern._runtime import Runtime
from cvkern.features._photographs import as_host
from cvkern.features.keypoints import sift
from cvkern.geometry.cameras.lens import straightened
from cvkern.panorama.registration import LEAST_SIDE, Heap

MOST_KEYPOINTS = 4000  # keypoints of a photograph
CONTRAST = 0.02  # half of SIFT's default: weak points are needed where there is little texture


class Lenses(NamedTuple):
    """The lenses of photographs, in pixels of the small photographs."""

    rows: np.ndarray
    """fx, fy, cx, cy, k1, k2, p1, p2, k3, (L, 9)."""
    of: np.ndarray
    """The lens of each photograph, (N,)."""
    told: np.ndarray
    """(L,) bool: the focal length was given, not guessed."""
    fixed: bool
    """Whether all lenses are known, and are not changed."""

    def matrices(self) -> np.ndarray:
        """Return camera matrices, (L, 3, 3)."""
        found = np.zeros((len(self.rows), 3, 3))
        found[:, 0, 0], found[:, 1, 1] = self.rows[:, 0], self.rows[:, 1]
        found[:, :2, 2] = self.rows[:, 2:4]
        found[:, 2, 2] = 1
        return found


class Keypoints(NamedTuple):
    """Keypoints of a photograph: each place once, though it may have several descriptors."""

    places: np.ndarray
    """(x, y), (N, 2) float64, pixels of the small photograph."""
    place_of: np.ndarray
    """The place of each descriptor, (D,)."""
    descriptors: Any
    """(D, 128) uint8, where kernels are."""
    responses: np.ndarray
    """(D,)."""
    colors: np.ndarray
    """The colour at each place, (N, 3) uint8."""


def find_keypoints(rt: Runtime, heap: Heap, i: int, most: int) -> Keypoints:
    """Find the keypoints of one of the photographs."""
    image, white = heap.small[i], heap.whites[i]
    if min(image.shape[:2]) < LEAST_SIDE:
        none = np.zeros((0, 2))
        empty = np.zeros(0, int)
        return Keypoints(
            none, empty, rt.give(np.zeros((0, 128), np.uint8)), empty, np.zeros((0, 3), np.uint8)
        )
    if len(image.shape) == 3 and image.shape[2] == 1:
        image = image.reshape(image.shape[:2])
    mask = None
    if len(image.shape) == 3 and image.shape[2] == 4:
        mask = image[..., 3]
    features = sift(
        image, most, mask=mask, spread=True, contrast_threshold=CONTRAST, data_range=white
    )
    points = as_host(rt, features.points).astype(np.float64)
    places, place_of = np.unique(points, axis=0, return_inverse=True)
    colors = _colors(as_host(rt, image), places, white)
    return Keypoints(
        np.ascontiguousarray(places[:, ::-1]), place_of.reshape(-1), features.descriptors,
        as_host(rt, features.responses), colors,
    )  # fmt: skip


def _colors(image: np.ndarray, places: np.ndarray, white: float) -> np.ndarray:
    """Return the colour of the nearest pixel, (N, 3) uint8."""
    near = np.floor(places + 0.5).astype(int)
    row, column = (near[:, i].clip(0, image.shape[i] - 1) for i in (0, 1))
    seen = image[row, column].astype(np.float64)
    seen = np.repeat(seen[:, None], 3, axis=1) if seen.ndim == 1 else seen[:, :3]
    return np.round(255 * (np.nan_to_num(seen) / white).clip(0, 1)).astype(np.uint8)


def rays_through(places: np.ndarray, lens: np.ndarray) -> np.ndarray:
    """Return x / z and y / z of the rays through places (x, y) of a lens, (N, 2)."""
    return straightened((places - lens[2:4]) / lens[:2], lens[4:])


Say = Callable[[int, int, str], None]
