"""Calls that compile the kernels of geometry."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from cvkern import geometry

# Functions that run on the host, or on kernels that the calls below compile.
NO_KERNELS = (
    "calibrate_camera", "calibrate_stereo", "chessboard_points", "epipolar_lines",
    "epipoles", "essential_from_fundamental", "find_essentials", "find_planes",
    "fit_affine", "fit_fundamental", "fit_homography", "fit_similarity",
    "pose_from_homography", "project_points", "read_calibration", "recover_pose",
    "rectify_stereo", "rectify_uncalibrated", "sampson_distance", "triangulate",
    "undistort_points", "write_calibration",
)  # fmt: skip


def calls() -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield a name and a call for every function and every model that has own kernels."""
    points = np.random.default_rng(0).uniform(0, 100, (40, 2))
    pair = points, points + 5.0
    for name in ("find_similarity", "find_affine", "find_homography", "find_fundamental"):
        yield name, partial(getattr(geometry, name), *pair)
    camera = np.array([[100.0, 0, 50], [0, 100, 50], [0, 0, 1]])
    scene = np.c_[points / 50 - 1, np.full(40, 4.0)]
    yield "find_essential", partial(geometry.find_essential, *pair, camera, camera)
    yield "find_pose", partial(geometry.find_pose, scene, points, camera)
    yield "find_homographies", partial(geometry.find_homographies, [pair, pair])
    yield "find_fundamentals", partial(geometry.find_fundamentals, [pair, pair])
    camera = geometry.Camera(np.eye(3), (), (4, 5))
    for dtype in (np.uint8, np.float32):
        for channels in ((), (3,)):
            image = np.zeros((4, 5, *channels), dtype)
            yield "undistort", partial(geometry.undistort, image, camera)
        board = 255 * (np.indices((60, 80)) // 20).sum(axis=0).astype(dtype) % 2
        yield "detect_chessboard", partial(geometry.detect_chessboard, board, (2, 3))
