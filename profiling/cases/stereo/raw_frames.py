"""Raw frames of two calibrated cameras: rectified, matched, and turned to depths."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import scipy.ndimage

import cvkern
from profiling.case import Case, Shape, Work
from profiling.cases.stereo.matching import disparities as most_disparities

NORMAL, AWAY = np.array([0.2, 0.1, 1.0]), 5.0  # a wall: normal . X = AWAY
TURN, NOISE = np.array([0.01, 0.03, -0.02]), 1.5
LIMIT = 0.02  # median relative distance from the wall: a tenth of a pixel of disparity and rims


def disparities(shape: Shape) -> int:
    """Return how many are searched: 128 but in toys."""
    return min(most_disparities(shape), 128)


@lru_cache
def _pair(shape: Shape) -> cvkern.StereoCalibration:
    """Return two cameras with lenses; the wall has disparities up to most of the range."""
    height, width = shape
    cameras = []
    for focal, lens in ((0.9, (-0.2, 0.05, 1e-3)), (0.92, (-0.15,))):
        matrix = np.diag([focal * width, focal * width, 1])
        matrix[:2, 2] = 0.5 * width, 0.49 * height
        cameras.append(cvkern.Camera(matrix, lens, shape))
    turn = cvkern.geometry.cameras.lens.turned(TURN)
    baseline = 0.45 * disparities(shape) * AWAY / width
    left, right = cameras
    turns, shifts = np.zeros((0, 3, 3)), np.zeros((0, 3))
    shift = turn @ np.array([-baseline, 0.01 * baseline, 0.02 * baseline])
    return cvkern.StereoCalibration(left, right, turn, shift, 0.0, turns, shifts, np.zeros(24))


@lru_cache
def _matcher(shape: Shape) -> cvkern.StereoMatcher:
    return cvkern.StereoMatcher.from_calibration(_pair(shape), (0, disparities(shape)), paths=4)


def _frames(shape: Shape, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Photograph a textured wall by both cameras, uint8."""
    pair = _pair(shape)
    rough = rng.normal(size=(2048, 2048))
    texture = sum(s * scipy.ndimage.gaussian_filter(rough, s, mode="wrap") for s in (1.0, 2.5, 6.0))
    texture = 127 + 45 * texture / np.std(texture)
    y, x = np.indices(shape)
    pixels = np.stack((y.ravel(), x.ravel()), axis=1).astype(float)
    seen = []
    for camera, turn, shift in (
        (pair.left, np.eye(3), np.zeros(3)),
        (pair.right, pair.rotation, pair.translation),
    ):
        rays = cvkern.undistort_points(pixels, camera, np.eye(3))[:, ::-1]
        rays = np.column_stack((rays, np.ones(len(rays)))) @ turn
        begin = -turn.T @ shift
        points = begin + ((AWAY - NORMAL @ begin) / (rays @ NORMAL))[:, None] * rays
        places = 1024 + 0.6 * shape[1] / AWAY * points[:, 1::-1].T
        view = scipy.ndimage.map_coordinates(texture, places, order=1, mode="grid-wrap")
        noisy = view.reshape(shape) + rng.normal(0, NOISE, shape)
        seen.append(noisy.round().clip(0, 255).astype(np.uint8))
    return seen[0], seen[1]


def _depth(left: Any, right: Any) -> Any:
    return _matcher(tuple(left.shape))(left, right).depth


def _wall(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    rectified = cvkern.rectify_stereo(_pair(left.shape), keep="valid")
    y, x = np.indices(left.shape)
    rays = np.stack((x, y, np.ones(left.shape)), axis=2) @ np.linalg.inv(rectified.matrix).T
    return AWAY / (rays @ rectified.rotations[0] @ NORMAL)


def _middle(ours: tuple[np.ndarray, ...], right: tuple[np.ndarray, ...]) -> float:
    gaps = np.abs(ours[0] - right[0]) / right[0]
    known = np.isfinite(gaps)
    return float(np.median(gaps[known])) if known.mean() > 0.6 else np.inf


CASES = (
    Case(
        name="raw_to_depth",
        title="Raw frames to depths, 128 disparities, 4 paths, checked, uint8",
        image=_frames,
        call=_depth,
        oracle=_wall,
        oracle_name="the wall that was photographed",
        difference=_middle,
        tolerance=LIMIT,
        bytes_per_pixel=2 + 18,
        operations_per_pixel=128 * 4 * 7,
        captures=False,  # the matcher is a captured call itself
        work=Work("DE", lambda left, right: left.size * disparities(left.shape)),
        sizes=("1080p",),
        most_inputs=2,
        margin=0,
    ),
)
