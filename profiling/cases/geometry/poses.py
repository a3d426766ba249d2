"""The pose of a camera before points in space, between matches with outliers."""

from __future__ import annotations

from typing import Any

import numpy as np

import cvkern
from profiling.case import TOY, Case, Peer, Shape, Work

CAMERA = np.array([[800.0, 0, 500], [0, 800, 375], [0, 0, 1]])
WIDTH, HEIGHT = 1000, 750
OUTLIERS, NOISE, THRESHOLD = 0.5, 0.5, 3.0  # pixels
LIMIT = 0.02  # distance of the camera's centre from the truth; the scene is 2 wide

Arrays = tuple[np.ndarray, ...]


def _inputs(shape: Shape, rng: np.random.Generator) -> Arrays:
    """Points (N, 3), where they are seen as (row, column), and the centre of the camera (3,)."""
    count = 200 if shape == TOY else 1000
    points = rng.uniform(-1, 1, (count, 3))
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    rotation = np.linalg.det(rotation) * rotation
    shift = np.array([0.1, -0.2, 4.0])
    q = (points @ rotation.T + shift) @ CAMERA.T
    seen = q[:, :2] / q[:, 2:] + rng.normal(0, NOISE, (count, 2))
    wild = rng.permutation(count) < OUTLIERS * count
    seen[wild] = rng.uniform(0, (WIDTH, HEIGHT), (int(wild.sum()), 2))
    return points, np.ascontiguousarray(seen[:, ::-1]), -rotation.T @ shift


def _ours(points: Any, seen: Any, centre: Any) -> Arrays:
    pose = cvkern.find_pose(points, seen, CAMERA, THRESHOLD)
    assert pose.rotation is not None
    return (-pose.rotation.T @ pose.translation,)


def _opencv(cv2: Any, points: np.ndarray, seen: np.ndarray, centre: np.ndarray) -> Arrays:
    places = np.ascontiguousarray(seen[:, ::-1])
    options: dict[str, Any] = {"flags": cv2.USAC_MAGSAC, "reprojectionError": THRESHOLD}
    *_, turn, shift, _ = cv2.solvePnPRansac(
        points, places, CAMERA, None, confidence=0.999, **options
    )
    return (-cv2.Rodrigues(turn)[0].T @ shift[:, 0],)


def _poselib(poselib: Any, points: np.ndarray, seen: np.ndarray, centre: np.ndarray) -> Arrays:
    camera = {"model": "PINHOLE", "width": WIDTH, "height": HEIGHT,
              "params": [CAMERA[0, 0], CAMERA[1, 1], CAMERA[0, 2], CAMERA[1, 2]]}  # fmt: skip
    options = {"max_reproj_error": THRESHOLD}
    pose, _ = poselib.estimate_absolute_pose(seen[:, ::-1], points, camera, options)
    return (-pose.R.T @ pose.t,)


CASES = (
    Case(
        name="pose_50",
        title="One pose of 1000 points, 50 % outliers",
        image=_inputs,
        call=_ours,
        oracle=lambda points, seen, centre: (centre,),
        oracle_name="the camera of the scene",
        difference=lambda ours, right: float(np.linalg.norm(ours[0] - right[0])),
        tolerance=LIMIT,
        bytes_per_pixel=1,
        operations_per_pixel=0,
        peers=(Peer("OpenCV", "cv2", _opencv), Peer("PoseLib", "poselib", _poselib)),
        captures=False,
        work=Work("points", lambda points, seen, centre: float(len(points))),
        sizes=("VGA",),  # points know no size
        most_inputs=2,
        margin=0,
    ),
)
