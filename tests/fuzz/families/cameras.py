"""Cameras: calibration, lenses, chessboards, poses."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import cvkern
from tests.fuzz.arguments import Call, Draw, Maker, alike, image, maybe, number, one, points, whole
from tests.fuzz.families.geometry import fundamental, inside

SHAPE = one((480, 640), (480, 640), (48, 64), (48, 64), (1, 1), (0, 4))
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
    for _ in range(int(draw.pick([0, 1, 3, 3, 4]))):
        turn, shift = draw.rng.normal(0, 0.4, 3), (-0.1, -0.05, draw.rng.uniform(0.3, 0.6))
        found = np.asarray(cvkern.project_points(BOARD, camera, turn, shift), np.float64)
        views.append(found + draw.rng.normal(0, draw.pick([0, 0.1, 9]), found.shape))
    if views and draw.odd(0.1):
        views[0] = views[0][:-1]
    return views


def space(draw: Draw) -> Any:
    """Return points in space, some behind the camera or not finite."""
    count = int(alike(draw).pick([0, 1, 4, 30, 30]))
    found = draw.rng.normal(0, 1, (count, 3)) * draw.pick([1, 1, 1, 1e-9, 1e30])
    found += draw.pick([0, 0, 5]) * np.array([0, 0, 1])
    if len(found) and draw.odd(0.2):
        found[0] = draw.pick([0, np.nan, np.inf])
    return found


def shown(draw: Draw) -> Any:
    """Return as many places in the image as points of :func:`space`."""
    count = int(alike(draw).pick([0, 1, 4, 30, 30])) if draw.odd(0.9) else 3
    return draw.rng.random((count, 2)) * 40


def board(draw: Draw) -> Any:
    """Return an image of a chessboard, or any image."""
    if draw.odd(0.5):
        return image(draw)
    found = 255 * np.kron(np.indices((7, 9)).sum(0) % 2, np.ones((9, 9)))
    return (found + draw.rng.normal(0, 2, found.shape)).clip(0, 255).astype(np.uint8)


PAIR = cvkern.make_scan("gray_code", (12, 16), (12, 16), seed=1).calibration


SIDE_BY_SIDE = PAIR._replace(
    rotation=cvkern.geometry.cameras.lens.turned(np.array([0.02, -0.1, 0.03])),
    translation=np.array([-0.2, 0.01, 0.02]),
)


def seen_by_two(draw: Draw, second: bool) -> Any:
    """Return what one of two cameras sees of a board in some views; both have one salt."""
    rng = np.random.default_rng(draw.salt)
    count, noise = int(rng.choice([0, 1, 3, 4])), rng.choice([0, 0.1, 9])
    camera = [CAMERA(draw._replace(rng=rng)) for _ in range(2)][second]
    views = []
    for _ in range(count):
        turn, shift = rng.normal(0, 0.4, 3), np.array([-0.1, -0.05, rng.uniform(0.3, 0.6)])
        found = cvkern.project_points(BOARD, camera, turn, shift - [0.05 * second, 0, 0])
        views.append(np.asarray(found, np.float64) + rng.normal(0, noise, found.shape))
    if views and draw.odd(0.1):
        views = views[1:] if draw.odd(0.5) else [*views[1:], views[0][:-1]]
    return views


def file_of(calibration: Any, name: Any) -> Any:
    """Write a calibration and read it again."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name if isinstance(name, str) else name
        try:
            cvkern.write_calibration(path, calibration)
            return cvkern.read_calibration(path)
        except (OSError, ValueError, TypeError) as error:  # its docstring names all of them
            raise type(error)(f"path {str(error).replace(folder, '')}") from None


def read_text(content: Any, shape: Any = None, name: str = "a.json") -> Any:
    """Read a calibration from a file of any content."""
    if not isinstance(content, bytes) or not isinstance(name, str):
        raise TypeError("content")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(content)
        try:
            return cvkern.read_calibration(path, shape)
        except ValueError as error:
            raise ValueError(f"path {str(error).replace(folder, '')}") from None


def harmed(ending: str) -> Maker:
    """Return a maker of the content of a calibration's file, some of its characters changed."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"a{ending}"
        cvkern.write_calibration(path, PAIR)
        whole_text = path.read_bytes()

    def make(draw: Draw) -> bytes:
        content = bytearray(whole_text)
        for _ in range(int(draw.rng.integers(0, 4))):
            at = int(draw.rng.integers(len(content)))
            part = draw.pick([b"", b"0", b"9" * 400, b"-", b"NaN", b"]", b"{", b"\xff", b"e9"])
            content[at : at + int(draw.rng.integers(0, 9))] = part
        return bytes(content[: len(content) if draw.odd(0.8) else draw.rng.integers(len(content))])

    return make


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
    "calibrate_stereo": Call(
        cvkern.calibrate_stereo,
        {
            "object_points": one(BOARD),
            "left_points": lambda draw: seen_by_two(draw, False),
            "right_points": lambda draw: seen_by_two(draw, True),
            "shape": SHAPE,
        },
        {
            "right_shape": maybe(SHAPE),
            "left": maybe(CAMERA),
            "right": maybe(CAMERA),
            "fixed": FIXED,
            "fix_cameras": one(False, True),
        },
    ),
    "write_calibration": Call(
        file_of,
        {"calibration": one(PAIR, PAIR.left), "name": one("a.json", "a.yml", "a.yaml", "a", "")},
        {},
    ),
    "read_calibration": Call(read_text, {"content": harmed(".json")}, {"shape": maybe(SHAPE)}),
    "read_calibration of YAML": Call(
        read_text, {"content": harmed(".yml"), "name": one("a.yml")}, {"shape": maybe(SHAPE)}
    ),
    "rectify_stereo": Call(
        cvkern.rectify_stereo,
        {
            "calibration": one(
                SIDE_BY_SIDE,
                SIDE_BY_SIDE,
                PAIR,
                PAIR._replace(translation=np.array([0, 0, 1.0])),
                PAIR.left,
            )
        },
        {"keep": one("scale", "valid", "all", "none"), "zoom": number(0.01, 9)},
    ),
    "Rectification": Call(
        lambda calibration, left, right, cval=0.0: tuple(
            cvkern.rectify_stereo(calibration)(left, right, cval=cval)
        ),
        {
            "calibration": one(SIDE_BY_SIDE, SIDE_BY_SIDE, PAIR),
            "left": lambda draw: image(draw, (12, 16)),
            "right": lambda draw: image(draw, (12, 16)),
        },
        {"cval": number(-5, 300)},
    ),
    "Camera": Call(
        lambda matrix, distortion=(), shape=(1, 1): repr(cvkern.Camera(matrix, distortion, shape)),
        {"matrix": inside},
        {"distortion": one((), (0.1,), (0.1, 0, 0, 0, 0), np.zeros(6), np.nan), "shape": SHAPE},
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
        cvkern.find_pose, {"points3d": space, "points2d": shown, "K": inside}, ROBUST
    ),
    "pose_from_homography": Call(cvkern.pose_from_homography, {"H": fundamental, "K": inside}, {}),
    "project_points": Call(cvkern.project_points, {"points": space, "camera": CAMERA}, POSED),
    "undistort": Call(
        cvkern.undistort,
        {
            "image": lambda draw: image(
                draw, draw.pick([(48, 64), (48, 64), (48, 64), (480, 640)])
            ),
            "camera": CAMERA,
        },
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
