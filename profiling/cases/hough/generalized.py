"""Shapes: a template found in a photograph, at any rotation and scale."""

from __future__ import annotations

import importlib
import math
from functools import partial
from typing import Any

import numpy as np
import scipy.ndimage

import cvkern
from profiling.arrays import photograph_uint8
from profiling.case import Case, Peer, Shape, Work

ROTATIONS, STEP = 360, 0.05
SCALES = np.linspace(0.8, 1.6, 17)
TURN, SIZE = 0.7, 1.3  # the template's, in the scene
LOW, HIGH = 50, 100  # thresholds of cv2.Canny: its Sobel is eight times a derivative
EDGES: dict[str, Any] = {"low_threshold": LOW, "high_threshold": HIGH}
NOWHERE = 1e9
WITHIN = 2.0, math.radians(2), 0.03  # pixels, radians, share: what counts as found

Arrays = tuple[np.ndarray, ...]


def _centre(shape: Shape) -> np.ndarray:
    return np.array(shape) / 2 + (0.3, -0.4)


def _inputs(shape: Shape, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A photograph with part of another in it, turned and scaled; and that part."""
    scene = photograph_uint8(shape, rng)
    photo = importlib.import_module("skimage.data").astronaut().mean(axis=2)
    side = 80 if min(shape) > 200 else 40
    corner = np.array([90, 200])
    y, x = np.indices(shape) - _centre(shape)[:, None, None]
    cosine, sine = math.cos(TURN) / SIZE, math.sin(TURN) / SIZE
    v, u = cosine * y - sine * x, sine * y + cosine * x
    shown = (np.abs(v) <= side / 2) & (np.abs(u) <= side / 2)
    middle = corner + (side - 1) / 2
    values = scipy.ndimage.map_coordinates(photo, [v[shown] + middle[0], u[shown] + middle[1]])
    scene[shown] = values.clip(0, 255).round()
    template = photo[corner[0] : corner[0] + side, corner[1] : corner[1] + side]
    return scene, template.round().astype(np.uint8)


def _find(scene: Any, template: Any) -> Arrays:
    found = cvkern.detect_shape(template, scene, rotations=ROTATIONS, scales=SCALES, **EDGES)
    return found[:3]


def _pose(scene: np.ndarray, template: np.ndarray) -> Arrays:
    return _centre(scene.shape)[None], np.array([TURN]), np.array([SIZE])


def _off(ours: Arrays, right: Arrays) -> float:
    """How far the first pose is off, by the worst of three measures: above 1 it is not found."""
    if not all(map(len, ours)):
        return NOWHERE
    gaps = [np.asarray(a[0], float) - b[0] for a, b in zip(ours, right, strict=True)]
    turned = (float(gaps[1]) + math.pi) % (2 * math.pi) - math.pi
    parts = np.hypot(*gaps[0]) / WITHIN[0], abs(turned) / WITHIN[1], abs(gaps[2]) / SIZE / WITHIN[2]
    return float(max(parts))


def _votes(scene: np.ndarray, template: np.ndarray) -> float:
    """Pairs of an edge point and a boundary point whose directions agree, for every scale."""
    table = cvkern.r_table(template, **EDGES)
    mask = cvkern.canny(scene, **EDGES, operator="gaussian", mode="reflect")
    entries = min(len(table.vectors), 500)
    # Over the full turn each pair agrees once.
    return float(mask.sum()) * entries * len(SCALES)


def _guil(cv2: Any, scene: np.ndarray, template: np.ndarray, dp: float = 1) -> Arrays:
    """Find the template by OpenCV, with an accumulator `dp` times coarser than the image."""
    hough = cv2.createGeneralizedHoughGuil()
    hough.setDp(dp)
    hough.setCannyLowThresh(LOW)
    hough.setCannyHighThresh(HIGH)
    hough.setMinScale(float(SCALES[0]))
    hough.setMaxScale(float(SCALES[-1]))
    hough.setScaleStep(STEP)
    hough.setMaxAngle(360)
    hough.setAngleStep(360 / ROTATIONS)
    hough.setTemplate(template)
    places, _ = hough.detect(scene)
    if places is None:
        return np.empty((0, 2)), np.empty(0), np.empty(0)
    x, y, scale, degrees = places[0, 0]
    return np.array([[y, x]]), np.array([math.radians(degrees)]), np.array([scale])


CASES = (
    Case(
        name="detect_shape",
        title="A shape of 80 x 80 pixels, 360 rotations, 17 scales, photograph, uint8",
        image=_inputs,
        call=_find,
        oracle=_pose,
        oracle_name="the pose it was put in",
        difference=_off,
        tolerance=1.0,
        bytes_per_pixel=1,
        operations_per_pixel=0,
        # Cells of 4 pixels are what `cvkern.detect_shape` begins with. Whatever `dp` is, Guil pairs
        # all points of the template, where ours takes at most 500 of them.
        peers=(
            Peer("OpenCV, Guil", "cv2", _guil),
            Peer("OpenCV, Guil, dp 2", "cv2", partial(_guil, dp=2), note="cells of 2 pixels"),
            Peer(
                "OpenCV, Guil, dp 4", "cv2", partial(_guil, dp=4), note="cells of 4 pixels, as ours"
            ),
        ),
        captures=False,
        work=Work("votes", _votes),
        sizes=("VGA",),  # the time of Guil grows with the square of the pixels
        most_inputs=4,
        margin=0,
    ),
)
