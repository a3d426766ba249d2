"""Bundle adjustment of cameras on a ring and points within it."""

from __future__ import annotations

from typing import Any

import numpy as np

import cvkern
from profiling.case import TOY, Case, Shape, Work

SIDES = 480, 640
FOCAL = 600.0
SEEN = 5  # neighbouring cameras that see a point
NOISE = 0.5  # pixels
SHAKEN = 0.01  # radians, and parts of the ring's radius of 4
# A statistic of 1200 coordinates at least: its relative spread is 1 / sqrt(2400) / 2 or less.
LIMIT = 0.02

Arrays = tuple[np.ndarray, ...]
COUNTS = {"toy": (6, 60), "VGA": (30, 10_000), "1080p": (100, 50_000)}


def _camera() -> cvkern.Camera:
    height, width = SIDES
    return cvkern.Camera([[FOCAL, 0, width / 2], [0, FOCAL, height / 2], [0, 0, 1]], (), SIDES)


def _turns(vectors: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(vectors).as_matrix()


def _inputs(shape: Shape, rng: np.random.Generator) -> Arrays:
    """Return poses, points, tracks and places; poses and points are off."""
    size = "toy" if shape == TOY else "VGA" if shape[0] <= SIDES[0] else "1080p"
    views, count = COUNTS[size]
    angles = 2 * np.pi * np.arange(views) / views
    turns = _turns(np.outer(-angles, [0, 1, 0]))
    eyes = turns @ np.array([0, 0, -4.0])
    points = rng.uniform(-1, 1, (count, 3))
    view = np.sort((rng.integers(0, views, count)[:, None] + np.arange(SEEN)) % views, axis=1)
    tracks = np.stack((np.repeat(np.arange(count), SEEN), view.ravel()), axis=1)
    inside = np.einsum("oji,oj->oi", turns[tracks[:, 1]], points[tracks[:, 0]] - eyes[tracks[:, 1]])
    places = FOCAL * inside[:, 1::-1] / inside[:, 2:] + np.array(SIDES) / 2
    places += rng.normal(0, NOISE, places.shape)
    shaken = _turns(rng.normal(0, SHAKEN, (views, 3))) @ turns
    eyes = eyes + rng.normal(0, 4 * SHAKEN, eyes.shape)
    poses = np.concatenate((shaken, eyes[:, :, None]), axis=2)
    return poses, points + rng.normal(0, 4 * SHAKEN, points.shape), tracks, places


def _ours(*given: Any) -> Arrays:
    poses, points, tracks, places = given
    found = cvkern.adjust_bundle(poses, _camera(), points, tracks, places, refine="distortion")
    return (np.sqrt(np.mean(found.errors**2, keepdims=True)),)


def _expected(*given: Any) -> Arrays:
    """Return the residual that noise leaves: each parameter takes the share of one number."""
    poses, points, tracks, _ = given
    numbers = 2 * len(tracks)
    free = numbers - 3 * len(points) - 6 * len(poses) - 3 + 7
    return (np.array([NOISE * np.sqrt(2 * free / numbers)]),)


CASES = (
    Case(
        name="adjust_bundle",
        title="Bundle adjustment: 30 cameras and 10 000 points (VGA), 100 and 50 000 (1080p)",
        image=_inputs,
        call=_ours,
        oracle=_expected,
        oracle_name="the residual that the noise leaves, by the number of parameters",
        difference=lambda ours, right: float(abs(ours[0][0] / right[0][0] - 1)),
        tolerance=LIMIT,
        bytes_per_pixel=8,
        operations_per_pixel=0,
        captures=False,
        work=Work("sightings", lambda *given: float(len(given[2]))),
        sizes=("VGA", "1080p"),
        most_inputs=2,
        margin=0,
    ),
)
