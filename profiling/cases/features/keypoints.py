"""Keypoints of a photograph, and their descriptors."""

from __future__ import annotations

import importlib
from functools import partial
from typing import Any

import numpy as np
import scipy.ndimage
import scipy.spatial

import cvkern
from profiling.arrays import photograph_uint8
from profiling.case import Case, Peer, Shape

CLOSE = 0.75  # pixels: OpenCV's points are a quarter of a pixel off, and smoothed a little more


def _photograph(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    """A photograph without the noise of its own: its points are structures."""
    smooth: Any = scipy.ndimage.gaussian_filter
    return smooth(photograph_uint8(shape, rng), 0.7)


def _of_opencv(cv2: Any, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    found, values = cv2.SIFT_create().detectAndCompute(image, None)
    values = np.empty((0, 128), np.float32) if values is None else values
    return np.array([p.pt[::-1] for p in found], np.float32).reshape(-1, 2), values


def _ours(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    found = cvkern.sift(image, root=False)
    return found.points, found.descriptors


def _strays(ours: tuple[np.ndarray, ...], right: tuple[np.ndarray, ...]) -> float:
    """Share of the points of the fewer that the other has not."""
    few, many = sorted((ours[0], right[0]), key=len)
    if not len(few):
        return 1.0
    return float((scipy.spatial.KDTree(many).query(few)[0] > CLOSE).mean())


EDGE = 21  # pixels at the border where ORB has no points


def _orb(image: np.ndarray) -> np.ndarray:
    """Corners of the first of eight sizes; all are found and described."""
    found = cvkern.orb(image, 500, fast_threshold=20 / 255)
    return found.points[found.scales == 1]


def _orb_of_opencv(cv2: Any, image: np.ndarray) -> np.ndarray:
    found, _ = cv2.ORB_create(500).detectAndCompute(image, None)
    return np.reshape(cv2.KeyPoint_convert(found), (-1, 2))[:, ::-1]


def _fast_of_opencv(image: np.ndarray) -> np.ndarray:
    """All pixels that are corners: of neighbours that are alike, OpenCV would keep none."""
    cv2: Any = importlib.import_module("cv2")
    found = cv2.FastFeatureDetector_create(20, False).detect(image)
    points = np.array([p.pt[::-1] for p in found], np.float32).reshape(-1, 2)
    inner = (points >= EDGE) & (points < np.array(image.shape) - EDGE)
    return points[inner.all(axis=1)]


def _no_corners(ours: tuple[np.ndarray, ...], right: tuple[np.ndarray, ...]) -> float:
    """Share of the points that are no corners."""
    (a,), (b,) = ours, right
    corners = set(map(tuple, b.tolist()))
    if not len(a):
        return float(len(b) > 0)
    return float(np.mean([tuple(p) not in corners for p in a.tolist()]))


# The answer is a list of points: its length is known on the host alone, so nothing is captured.
points_of = partial(
    Case, bytes_per_pixel=1, operations_per_pixel=0, captures=False, sizes=("1080p",),
    most_inputs=2, margin=0,
)  # fmt: skip

CASES = (
    points_of(
        name="orb",
        title="ORB of a photograph, 500 points of 8 sizes, uint8",
        image=photograph_uint8,
        call=_orb,
        oracle=_fast_of_opencv,
        oracle_name="cv2.FastFeatureDetector",
        difference=_no_corners,
        tolerance=0.0,
        peers=(Peer("OpenCV", "cv2", _orb_of_opencv, note="points of all sizes"),),
    ),
    points_of(
        name="sift",
        title="SIFT of a photograph, doubled base, all points, uint8",
        image=_photograph,
        call=_ours,
        oracle=lambda x: _of_opencv(importlib.import_module("cv2"), x),
        oracle_name="cv2.SIFT",
        difference=_strays,
        tolerance=0.25,
        peers=(Peer("OpenCV", "cv2", _of_opencv),),
    ),
)
