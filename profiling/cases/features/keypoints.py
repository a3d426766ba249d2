"""Keypoints of a photograph, and their descriptors."""

from __future__ import annotations

import importlib
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


CASES = (
    Case(
        name="sift",
        title="SIFT of a photograph, doubled base, all points, uint8",
        image=_photograph,
        call=_ours,
        oracle=lambda x: _of_opencv(importlib.import_module("cv2"), x),
        oracle_name="cv2.SIFT",
        difference=_strays,
        tolerance=0.25,
        bytes_per_pixel=1,
        operations_per_pixel=0,
        captures=False,
        peers=(Peer("OpenCV", "cv2", _of_opencv),),
        sizes=("1080p",),
        most_inputs=2,
        margin=0,
    ),
)
