"""Calibration of two cameras from pairs of photographs of a board."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cvkern._checks import check_flag
from cvkern.geometry._matrices import nearest_rotations
from cvkern.geometry.cameras._adjustment import Poses, Residuals, adjust, crossed, projected
from cvkern.geometry.cameras.calibration import (
    adjusted_camera,
    begun,
    camera_of,
    check_enough,
    check_shape,
    check_views,
    free_of,
    rms_of,
    seen_by_cameras,
)
from cvkern.geometry.cameras.lens import Camera, check_lens, turned


class StereoCalibration(NamedTuple):
    """Two cameras, and the pose of the second relative to the first."""

    left: Camera
    """The first camera."""
    right: Camera
    """The second camera."""
    rotation: np.ndarray
    """First camera to second, (3, 3) float64: X1 = R X0 + t."""
    translation: np.ndarray
    """t of the same, (3,) float64, in the unit of the object points; its length is the baseline."""
    rms: float
    """Root mean square of the distances between seen and projected points of both, pixels."""
    rotations: np.ndarray
    """World (board) to first camera, (V, 3, 3) float64: X0 = R W + t, the inverse of a
    camera-to-world pose."""
    translations: np.ndarray
    """t of the same, (V, 3) float64."""
    deviations: np.ndarray
    """Standard deviations, (24,) float64: fx, fy, cx, cy, k1, k2, p1, p2, k3 of the first camera,
    then of the second, a turn of the second about its axes (radians), and the translation."""

    @property
    def essential(self) -> np.ndarray:
        """Essential matrix, (3, 3) float64: b' E a = 0 for rays (x, y, 1) of both cameras."""
        x, y, z = self.translation
        return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ self.rotation

    @property
    def fundamental(self) -> np.ndarray:
        """Fundamental matrix, (3, 3) float64, for undistorted pixels (x, y, 1)."""
        left, right = (np.linalg.inv(camera.matrix) for camera in (self.left, self.right))
        return right.T @ self.essential @ left


def check_stereo(calibration: Any) -> StereoCalibration:
    """Return a calibration of two cameras, and refuse anything else."""
    if not isinstance(calibration, StereoCalibration):
        said = type(calibration).__name__
        raise TypeError(f"calibration must be a StereoCalibration, got {said}")
    return calibration


def calibrate_stereo(
    object_points: Any,
    left_points: Sequence[Any],
    right_points: Sequence[Any],
    shape: tuple[int, int],
    *,
    right_shape: tuple[int, int] | None = None,
    left: Camera | None = None,
    right: Camera | None = None,
    fixed: Sequence[str] = (),
    fix_cameras: bool = False,
) -> StereoCalibration:
    """Calibrate two cameras and their relative pose from pairs of views of a board.

    Parameters
    ----------
    object_points : array of shape (N, 3), or a sequence of V such arrays
        As in :func:`calibrate_camera`.
    left_points, right_points : sequence of V arrays of shape (N, 2)
        Row and column of these points in the images of the first and of the second camera.
    shape : (int, int)
        Rows and columns of the images of both cameras, or of the first one.
    right_shape : (int, int), optional
        Rows and columns of the images of the second camera, if they differ.
    left, right : Camera, optional
        Initial cameras. By default :func:`calibrate_camera` finds each one alone.
    fixed : sequence of str, default ()
        Parameters that stay fixed in both cameras, as in :func:`calibrate_camera`.
    fix_cameras : bool, default False
        Keep both initial cameras, and find only the relative pose.

    Returns
    -------
    StereoCalibration
        Named tuple of `left`, `right`, `rotation`, `translation`, `rms`, `rotations`,
        `translations` and `deviations`; `essential` and `fundamental` are derived from them.

    Raises
    ------
    TypeError
        If an array does not hold real numbers, or a camera is not a Camera.
    ValueError
        As :func:`calibrate_camera`; or if the lists differ in length.

    See Also
    --------
    rectify_stereo : Make the rows of both images correspond.

    Notes
    -----
    The result is a local minimum of the sum of squared distances in both images, as in
    ``cv2.stereoCalibrate``, which by default keeps the cameras fixed. A board that looks the same
    when turned by 180 degrees must start at the same corner in both images.

    References
    ----------
    .. [1] Z. Zhang, "A flexible new technique for camera calibration", IEEE PAMI 22(11), 2000.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> board = cvkern.chessboard_points((4, 5))
    >>> camera = cvkern.Camera([[500, 0, 320], [0, 500, 240], [0, 0, 1]], [-0.1], (480, 640))
    >>> turns = [(0.5, 0, 0), (0, 0.5, 0), (-0.3, -0.4, 0.2), (0.2, 0.6, 0)]
    >>> left, right = (
    ...     [cvkern.project_points(board, camera, turn, (x, -1.5, 9)) for turn in turns]
    ...     for x in (-2, -3)
    ... )
    >>> found = cvkern.calibrate_stereo(board, left, right, (480, 640))
    >>> found.translation.round(3) + 0
    array([-1.,  0.,  0.])
    """
    shapes = shape, shape if right_shape is None else right_shape
    points = Seen("left_points", left_points, "left"), Seen("right_points", right_points, "right")
    return calibrate_two(object_points, points, shapes, (left, right), fixed, fix_cameras)


class Seen(NamedTuple):
    """The argument that has the points that a camera sees, and the argument that is the camera."""

    name: str
    points: Sequence[Any]
    camera: str


def calibrate_two(
    object_points: Any,
    points: tuple[Seen, Seen],
    sizes: tuple[Any, Any],
    cameras: tuple[Camera | None, Camera | None],
    fixed: Sequence[str],
    fix_cameras: bool,
) -> StereoCalibration:
    """Do as :func:`calibrate_stereo`, with points whose refusals bear other names."""
    shapes = [check_shape(size) for size in sizes]
    boards, lefts = check_views(object_points, points[0].points, points[0].name)
    again, rights = check_views(object_points, points[1].points, points[1].name)
    if len(again) != len(boards):
        raise ValueError(
            f"{points[1].name} must be of as many views as {points[0].name}, {len(boards)}, "
            f"got {len(again)}"
        )
    fixed_names, keep = free_of(fixed), check_flag(fix_cameras, "fix_cameras")
    check_enough(boards, fixed_names, points[0].name)
    numbers, poses = [], []
    for camera, places, shape, seen in zip(cameras, (lefts, rights), shapes, points, strict=True):
        if camera is not None:
            check_lens(camera, seen.camera)
        given, stood = begun(boards, places, shape, camera, seen.camera)
        free = fixed_names & (camera is None)
        alone = adjusted_camera(boards, places, given, stood, free, seen.name)
        numbers.append(alone.shared[:9])
        poses.append(alone.poses)
    with seen_by_cameras(points[1].name):
        turn, shift = _beside(*poses)

    views = np.repeat(np.arange(len(boards)), [len(b) for b in boards])
    world, images = np.concatenate(boards), [np.concatenate(p) for p in (lefts, rights)]
    both = np.repeat(views, 2)

    def evaluate(shared: np.ndarray, poses: Poses) -> Residuals:
        turned_world = np.einsum("mij,mj->mi", poses.rotations[views], world)
        inside = turned_world + poses.translations[views]
        rotation, translation = shared[18:27].reshape(3, 3), shared[27:]
        beside = inside @ rotation.T
        one, other = projected(inside, shared[:9]), projected(beside + translation, shared[9:18])
        spin = crossed(turned_world)
        onward = other.by_point @ rotation
        none = np.zeros((len(world), 2, 9))
        six = np.zeros((len(world), 2, 6))
        by_pair = np.concatenate((other.by_point @ crossed(beside), other.by_point), axis=2)
        off, shares, by_pose = (
            np.stack(pair, axis=1).reshape(2 * len(world), *pair[0].shape[1:])
            for pair in (
                (one.places - images[0], other.places - images[1]),
                (
                    np.concatenate((one.by_camera, none, six), axis=2),
                    np.concatenate((none, other.by_camera, by_pair), axis=2),
                ),
                (
                    np.concatenate((one.by_point @ spin, one.by_point), axis=2),
                    np.concatenate((onward @ spin, onward), axis=2),
                ),
            )
        )
        return Residuals(off, shares, by_pose)

    begin = np.concatenate((*numbers, turn.ravel(), shift))
    moving = fixed_names & (not keep)
    free = np.concatenate((moving, moving, np.ones(6, bool)))
    with seen_by_cameras(points[0].name):
        found = adjust(evaluate, _moved, begin, poses[0], both, free)
    seen_by_both = zip((found.shared[:9], found.shared[9:18]), shapes, points, strict=True)
    left, right = (camera_of(lens, shape, seen.name) for lens, shape, seen in seen_by_both)
    return StereoCalibration(
        left, right,
        found.shared[18:27].reshape(3, 3), found.shared[27:], rms_of(found.residuals.off),
        *found.poses, found.deviations,
    )  # fmt: skip


def _moved(shared: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Return cameras, rotation and translation after a step of 24 numbers."""
    rotation = turned(step[18:21]) @ shared[18:27].reshape(3, 3)
    return np.concatenate((shared[:18] + step[:18], rotation.ravel(), shared[27:] + step[21:24]))


def _beside(left: Poses, right: Poses) -> tuple[np.ndarray, np.ndarray]:
    """Return the rotation and translation from the first camera to the second, over all views."""
    turn = nearest_rotations((right.rotations @ left.rotations.transpose(0, 2, 1)).sum(axis=0))
    return turn, np.median(right.translations - left.translations @ turn.T, axis=0)
