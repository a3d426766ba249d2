"""Poses of a camera before points and before a plane: rendered truth, OpenCV, bad input."""

from typing import Any

import cv2
import numpy as np
import pytest

import cvkern
from cvkern._runtime import KERNEL_SETS
from tests.geometry.reference_robust import ROTATION
from tests.refusals import refused

CAMERA = np.array([[600.0, 5, 320], [0, 580, 240], [0, 0, 1]])


def view(seed, count=200, outliers=0.3, noise=0.5, far=0.0):
    """Points around a place in the world, how they are seen, which are wild, and the pose."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1, 1, (count, 3)) * (2, 2, 1) + far
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    rotation = np.linalg.det(rotation) * rotation
    translation = np.array([0.1, -0.2, 6]) - rotation @ np.full(3, far)
    q = (points @ rotation.T + translation) @ CAMERA.T
    seen = q[:, 1::-1] / q[:, 2:] + rng.normal(0, noise, (count, 2))
    wild = rng.permutation(count) < round(outliers * count)
    seen[wild] = rng.uniform(0, (480, 640), (wild.sum(), 2))
    return points, seen, wild, rotation, translation


@pytest.mark.parametrize(
    ("count", "outliers", "noise", "far", "turn", "place"),
    [(30, 0.0, 0.0, 0.0, 1e-6, 1e-6), (200, 0.3, 0.5, 0.0, 2e-3, 0.02),
     (400, 0.7, 0.5, 1e3, 2e-3, 0.02)],
)  # fmt: skip
def test_finds_the_truth(count, outliers, noise, far, turn, place):
    for seed in range(3):
        points, seen, wild, rotation, translation = view(seed, count, outliers, noise, far)
        pose: Any = cvkern.find_pose(points, seen, CAMERA)
        np.testing.assert_allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-12)
        assert np.abs(pose.rotation - rotation).max() < turn
        centre, right = -pose.rotation.T @ pose.translation, -rotation.T @ translation
        assert np.linalg.norm(centre - right) < place
        q = (points @ pose.rotation.T + pose.translation) @ CAMERA.T
        near = np.linalg.norm(q[:, 1::-1] / q[:, 2:] - seen, axis=1) < 3
        assert np.sum(near != pose.inliers) <= 1
        assert pose.inliers[~wild].mean() > 0.98


def test_as_good_as_opencv():
    """The centre of the camera against OpenCV's P3P with least squares over its inliers."""
    ours, theirs = [], []
    for seed in range(10):
        points, seen, _, rotation, translation = view(seed, 100, 0.4)
        right = -rotation.T @ translation
        pose: Any = cvkern.find_pose(points, seen, CAMERA)
        ours.append(np.linalg.norm(-pose.rotation.T @ pose.translation - right))
        found, turn, shift, inside = cv2.solvePnPRansac(
            points, seen[:, ::-1].copy(), CAMERA, None, flags=cv2.SOLVEPNP_P3P,
            reprojectionError=3.0, iterationsCount=1000,
        )  # fmt: skip
        assert found
        rows: Any = inside[:, 0]
        turn, shift = cv2.solvePnPRefineLM(
            points[rows], seen[rows, ::-1].copy(), CAMERA, None, turn, shift
        )
        theirs.append(np.linalg.norm(-cv2.Rodrigues(turn)[0].T @ shift[:, 0] - right))
    assert np.mean(ours) < 1.05 * np.mean(theirs)


def test_points_behind_the_camera_are_outliers():
    points, seen, _, rotation, translation = view(0, 60, 0.0, 0.0)
    centre = -rotation.T @ translation
    mirrored = 2 * centre - points[:20]  # on the same rays, behind
    pose = cvkern.find_pose(np.r_[points, mirrored], np.r_[seen, seen[:20]], CAMERA)
    assert pose.inliers[:60].all()
    assert not pose.inliers[60:].any()


def test_order_does_not_matter_and_sets_are_equal():
    points, seen, *_ = view(1, 80, 0.3)
    points[3], seen[5] = np.nan, np.inf
    one = cvkern.find_pose(points, seen, CAMERA, max_trials=512)
    assert not one.inliers[[3, 5]].any()
    order = np.random.default_rng(0).permutation(80)
    for name in KERNEL_SETS:
        with cvkern.use(backend=name):
            other = cvkern.find_pose(points[order], seen[order], CAMERA, max_trials=512)
        np.testing.assert_array_equal(one.rotation, other.rotation)
        np.testing.assert_array_equal(one.translation, other.translation)
        np.testing.assert_array_equal(one.inliers[order], other.inliers)
        assert one.cost == other.cost


def test_no_pose():
    points, seen, *_ = view(0, 100, 1.0)
    line = np.outer(np.arange(20.0), (1, 2, 3))
    for a, b in ((points, seen), (points[:3], seen[:3]), (line, seen[:20]), (points[:0], seen[:0])):
        pose = cvkern.find_pose(a, b, CAMERA, max_trials=1024)
        assert pose.rotation is None
        assert pose.translation is None
        assert not pose.inliers.any()
        assert pose.cost == len(a)


@pytest.mark.parametrize("name", KERNEL_SETS)
def test_on_a_gpu(gpu, name):
    points, seen, *_ = view(0, 1000, 0.5)
    right: Any = cvkern.find_pose(points, seen, CAMERA)
    with cvkern.use(backend=name, device="cuda"):
        pose: Any = cvkern.find_pose(points, seen, CAMERA)
    if name == "warp":
        np.testing.assert_array_equal(pose.rotation, right.rotation)
    np.testing.assert_allclose(pose.translation, right.translation, atol=1e-6)
    np.testing.assert_array_equal(pose.inliers, right.inliers)


def test_pose_of_a_plane():
    translation = np.array([0.4, -0.3, 5.0])
    for sign in (1, -1):
        matrix = sign * 7 * CAMERA @ np.c_[ROTATION[:, :2], translation]
        pose = cvkern.pose_from_homography(matrix, CAMERA)
        np.testing.assert_allclose(pose.rotation, ROTATION, atol=1e-12)
        np.testing.assert_allclose(pose.translation, translation, atol=1e-12)
    # With errors the pose is near that of OpenCV's least squares over the four corners.
    corners = np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
    q = np.c_[corners, np.zeros(4)] @ ROTATION.T + translation
    seen = (q @ CAMERA.T)[:, :2] / q[:, 2:] + np.random.default_rng(0).normal(0, 0.3, (4, 2))
    pose = cvkern.pose_from_homography(
        cvkern.fit_homography(corners[:, ::-1], seen[:, ::-1]), CAMERA
    )
    _, turn, shift = cv2.solvePnP(np.c_[corners, np.zeros(4)], seen, CAMERA, None)
    assert np.abs(pose.rotation - cv2.Rodrigues(turn)[0]).max() < 0.02
    assert np.abs(pose.translation - shift[:, 0]).max() < 0.05
    assert np.linalg.det(pose.rotation) == pytest.approx(1)


def test_refusals():
    points, seen, *_ = view(0, 10)
    message = "points3d must have shape (N, 3), got (10, 2)"
    refused(ValueError, message, cvkern.find_pose, seen, seen, CAMERA)
    message = "points2d must be as many as points3d, 10, got 9"
    refused(ValueError, message, cvkern.find_pose, points, seen[:9], CAMERA)
    message = "K must have an inverse, got a matrix of rank below 3"
    refused(ValueError, message, cvkern.find_pose, points, seen, np.zeros((3, 3)))
    message = "H must have an inverse, got a matrix of rank below 3"
    refused(ValueError, message, cvkern.pose_from_homography, np.ones((3, 3)), CAMERA)
    message = "H must put the origin of the plane before the camera, got it beside"
    beside = CAMERA @ np.array([[1.0, 0, 1], [0, 0, 1], [0, 1, 0]])
    refused(ValueError, message, cvkern.pose_from_homography, beside, CAMERA)


def test_the_scale_of_a_plane_is_the_mean_of_both_axes():
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    matrix = np.column_stack((turn[:, 0] * 1.1, turn[:, 1] * 0.9, [0.1, 0.2, 3.0]))
    found = cvkern.pose_from_homography(matrix, np.eye(3))
    np.testing.assert_allclose(found.translation, [0.1, 0.2, 3.0], rtol=1e-12)
    np.testing.assert_allclose(found.rotation, turn, atol=1e-12)
