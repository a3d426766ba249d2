"""Measures of corners."""

from __future__ import annotations

import importlib

import numpy as np

import cvkern
from profiling.arrays import photograph
from profiling.case import Case, Peer, relative, skimage_peers

CASES = (
    Case(
        name="corner_harris",
        title="Harris measure of corners, sigma 1, float32",
        image=photograph,
        call=cvkern.corner_harris,
        oracle=lambda x: importlib.import_module("skimage.feature").corner_harris(
            x.astype(np.float64)
        ),
        oracle_name="skimage.feature.corner_harris",
        difference=relative,
        tolerance=1e-5,
        bytes_per_pixel=8,
        operations_per_pixel=2 * (12 + 3 * 18) + 10,
        peers=(
            *skimage_peers("feature", lambda m, x: m.corner_harris(x)),
            Peer(
                "OpenCV",
                "cv2",
                lambda m, x: m.cornerHarris(x, 3, 3, 0.05),
                note="a box of 3 x 3 for the Gaussian",
            ),
        ),
    ),
)
