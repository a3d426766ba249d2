"""Images without the bend of a lens."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

import cvkern
from profiling.case import Case, Peer, Shape

LENS = (-0.28, 0.11, 1.3e-3, -7e-4, -0.03)
TURN = np.array([0.02, -0.03, 0.01])


@lru_cache
def _camera(shape: Shape) -> cvkern.Camera:
    height, width = shape
    matrix = np.diag([0.8 * width, 0.8 * width, 1])
    matrix[:2, 2] = 0.49 * width, 0.51 * height
    return cvkern.Camera(matrix, LENS, shape)


@lru_cache
def _maps(shape: Shape) -> Any:
    """Return OpenCV's map, which a user makes once: no part of what is timed."""
    import cv2

    camera = _camera(shape)
    turn = cv2.Rodrigues(TURN)[0]
    return cv2.initUndistortRectifyMap(
        camera.matrix, camera.distortion, turn, camera.matrix, shape[::-1], cv2.CV_32FC1
    )


def _photograph(channels: tuple[int, ...]) -> Any:
    def make(shape: Shape, rng: np.random.Generator) -> np.ndarray:
        noise = rng.integers(0, 256, (*shape, *channels), np.uint8)
        soft = cvkern.gaussian(noise, 3.0, channel_axis=-1 if channels else None)
        return (127 + 4 * (soft - 127)).clip(0, 255).astype(np.uint8)

    return make


def _call(image: Any) -> Any:
    return cvkern.undistort(image, _camera(tuple(image.shape[:2])), rotation=TURN)


def _exact(image: np.ndarray) -> np.ndarray:
    """Sample by SciPy, at the places of OpenCV's map; 0 outside."""
    from scipy.ndimage import map_coordinates

    x, y = (m.astype(np.float64) for m in _maps(image.shape[:2]))
    planes = np.atleast_3d(image).astype(np.float64)
    found = [map_coordinates(planes[..., c], (y, x), order=1) for c in range(planes.shape[2])]
    return np.stack(found, axis=2).reshape(image.shape)


def _farthest(ours: tuple[np.ndarray, ...], right: tuple[np.ndarray, ...]) -> float:
    """The difference that one pixel in a thousand exceeds: its border may round otherwise."""
    gaps = np.abs(ours[0].astype(np.float64) - right[0])
    return float(np.quantile(gaps, 0.999))


def _peer(cv2: Any, image: np.ndarray) -> np.ndarray:
    return cv2.remap(image, *_maps(image.shape[:2]), cv2.INTER_LINEAR)


def _case(name: str, title: str, channels: tuple[int, ...]) -> Case:
    count = int(np.prod(channels, dtype=int))
    return Case(
        name=name,
        title=title,
        image=_photograph(channels),
        call=_call,
        oracle=_exact,
        oracle_name="SciPy, with OpenCV's map",
        difference=_farthest,
        tolerance=1.0,
        bytes_per_pixel=2 * count,
        operations_per_pixel=60 + 8 * count,
        peers=(Peer("OpenCV", "cv2", _peer, note="its map is made before"),),
        margin=0,
    )


CASES = (
    _case("undistort", "Undistorted and turned, uint8", ()),
    _case("undistort_color", "Undistorted and turned, uint8 x 3", (3,)),
)
