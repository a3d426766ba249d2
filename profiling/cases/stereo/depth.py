"""Depth and points from disparities."""

from __future__ import annotations

from typing import Any

import numpy as np

import cvkern
from profiling.case import Case, Peer, Shape, relative

FOCAL, BASELINE, DOFFS = 994.978, 193.001, 31.086
Q = cvkern.reprojection_matrix(FOCAL, BASELINE, 311.193, 254.877, DOFFS)
# Each coordinate above and below is a sum of four products of rounded factors: 8 roundings of
# 2^-24 each, of terms no larger than twice the sum; then the quotient.
FLOAT32 = 2e-6


def _disparities(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    return 1 + 127 * rng.random(shape, np.float32)


def _depth(x: np.ndarray) -> np.ndarray:
    return FOCAL * BASELINE / (x.astype(np.float64) + DOFFS)


def _points(x: np.ndarray) -> np.ndarray:
    rows, columns = np.indices(x.shape)
    mapped = np.stack([columns, rows, x.astype(np.float64), np.ones(x.shape)], -1) @ Q.T
    return mapped[..., :3] / mapped[..., 3:]


def _numpy(np_like: Any, x: Any) -> Any:
    return FOCAL * BASELINE / (x + DOFFS)


CASES = (
    Case(
        name="disparity_to_depth",
        title="Depth of disparities, float32",
        image=_disparities,
        call=lambda x: cvkern.disparity_to_depth(x, FOCAL, BASELINE, DOFFS),
        oracle=_depth,
        oracle_name="NumPy in float64",
        difference=relative,
        tolerance=FLOAT32,
        bytes_per_pixel=8,
        operations_per_pixel=2,
        peers=(
            Peer("NumPy", "numpy", _numpy, note="no test of what is not finite"),
            Peer("torch", "torch", _numpy, "cuda", "no test of what is not finite"),
        ),
    ),
    Case(
        name="points_from_disparity",
        title="Points of disparities, float32",
        image=_disparities,
        call=lambda x: cvkern.points_from_disparity(x, Q),
        oracle=_points,
        oracle_name="NumPy in float64",
        difference=relative,
        tolerance=FLOAT32,
        bytes_per_pixel=16,
        operations_per_pixel=4 * 7 + 3,
        peers=(Peer("OpenCV", "cv2", lambda m, x: m.reprojectImageTo3D(x, Q)),),
    ),
)
