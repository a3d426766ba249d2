"""Cameras: calibration, lenses, chessboards, poses."""

from __future__ import annotations

from typing import Any

import numpy as np

import cvkern
from tests.fuzz.arguments import Call, Draw, Maker, image, maybe, number, one, points, whole
from tests.fuzz.families.geometry import fundamental, inside

SHAPE = one((480, 640), (48, 64), (1, 1), (0, 4))
CAMERA = one(
    cvkern.Camera(np.array([[500, 0, 319.5], [0, 500, 239.5], [0, 0, 1]]), [-0.2, 0.1], (480, 640)),
    cvkern.Camera(np.array([[40, 0, 31.5], [0, 40, 23.5], [0, 0, 1]]), (), (48, 64)),
)
BOARD = cvkern.chessboard_points((5, 7), 0.03)


def turned(draw: Draw) -> Any:
    """Return a rotation vector, a matrix, or what is neither."""
    return draw.pick([(0.1, 0.2, 0.3), (0, 0, 0), np.eye(3), np.ones((3, 3)), (1, 2)])


def moved(draw: Draw) -> Any:
    """Return a translation that is mostly in front of the camera."""
    return draw.pick([(0, 0, 1), (-0.1, 0.1, 0.5), (0, 0, -1), (0, 0, 0), (1e30, 0, 1)])


def seen(draw: Draw) -> Any:
    """Return what a camera sees of a board in some views, with noise."""
    views = []
    camera = CAMERA(draw)
    for _ in range(int(draw.pick([0, 1, 3, 5]))):
        turn, shift = draw.rng.normal(0, 0.4, 3), (-0.1, -0.05, draw.rng.uniform(0.3, 0.6))
        found = np.asarray(cvkern.project_points(BOARD, camera, turn, shift), np.float64)
        views.append(found + draw.rng.normal(0, draw.pick([0, 0.1, 9]), found.shape))
    if views and draw.odd(0.1):
        views[0] = views[0][:-1]
    return views


def space(draw: Draw) -> Any:
    """Return points in space, some behind the camera or not finite."""
    found = draw.rng.normal(0, 1, (int(draw.pick([0, 1, 4, 30])), 3)) * draw.pick(
        [1, 1, 1e-9, 1e30]
    )
    if len(found) and draw.odd(0.2):
        found[0] = draw.pick([0, np.nan, np.inf])
    return found


def board(draw: Draw) -> Any:
    """Return an image of a chessboard, or any image."""
    if draw.odd(0.5):
        return image(draw)
    found = 255 * np.kron(np.indices((7, 9)).sum(0) % 2, np.ones((9, 9)))
    return (found + draw.rng.normal(0, 2, found.shape)).clip(0, 255).astype(np.uint8)


FIXED = one((), ("distortion",), ("k3",), ("fx", "fy"), ("no",))
POSED: dict[str, Maker] = {"rotation": maybe(turned), "translation": maybe(moved)}
ROBUST: dict[str, Maker] = {
    "threshold": number(0.1, 9),
    "confidence": number(0.5, 0.9999),
    "max_trials": whole(1, 64),
    "seed": whole(0, 9),
}
CALLS: dict[str, Call] = {
    "calibrate_camera": Call(
        cvkern.calibrate_camera,
        {"object_points": one(BOARD), "image_points": seen, "shape": SHAPE},
        {"camera": maybe(CAMERA), "fixed": FIXED},
    ),
    "chessboard_points": Call(
        cvkern.chessboard_points,
        {"shape": one((5, 7), (2, 2), (1, 1), 3)},
        {"square": number(0, 9)},
    ),
    "detect_chessboard": Call(
        cvkern.detect_chessboard, {"image": board, "shape": one((6, 8), (6, 8), (3, 3), (2, 1))}, {}
    ),
    "find_pose": Call(
        cvkern.find_pose, {"points3d": space, "points2d": points, "K": inside}, ROBUST
    ),
    "pose_from_homography": Call(cvkern.pose_from_homography, {"H": fundamental, "K": inside}, {}),
    "project_points": Call(cvkern.project_points, {"points": space, "camera": CAMERA}, POSED),
    "undistort": Call(
        cvkern.undistort,
        {"image": lambda draw: image(draw, draw.pick([(48, 64), (480, 640)])), "camera": CAMERA},
        {
            "matrix": maybe(inside),
            "rotation": maybe(turned),
            "shape": maybe(one((20, 30), (1, 1), (0, 1))),
            "cval": number(-5, 300),
        },
    ),
    "undistort_points": Call(
        cvkern.undistort_points,
        {"points": points, "camera": CAMERA},
        {"matrix": maybe(inside), "rotation": maybe(turned)},
    ),
}
