"""Relative poses and triangulation, against rendered truth, OpenCV and SciPy."""

import cv2
import numpy as np
import pytest
import scipy.optimize

import cvkern
from cvkern.geometry.views import _in_front
from tests.geometry.reference_robust import ROTATION, TRANSLATION
from tests.geometry.test_epipolar import CAMERA, scene, true_matrix
from tests.refusals import refused

OTHER = np.array([[500.0, 2, 300], [0, 520, 200], [0, 0, 1]])
FIRST = np.c_[CAMERA, np.zeros(3)]
SECOND = OTHER @ np.c_[ROTATION, TRANSLATION]
THIRD = CAMERA @ np.c_[ROTATION.T, (-0.3, 0.2, 0.1)]


def seen(matrix, points):
    q = np.c_[points, np.ones(len(points))] @ matrix.T
    return (q[:, :2] / q[:, 2:])[:, ::-1]


def space(count=40, seed=0):
    return np.random.default_rng(seed).uniform((-1.5, -1, 3), (1.5, 1, 7), (count, 3))


def cross(t):
    return np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])


def test_essential_matrix():
    f = np.linalg.inv(OTHER).T @ cross(TRANSLATION) @ ROTATION @ np.linalg.inv(CAMERA)
    found = cvkern.essential_from_fundamental(f, CAMERA, OTHER)
    right = cross(TRANSLATION / np.linalg.norm(TRANSLATION)) @ ROTATION
    np.testing.assert_allclose(found * np.sign((found * right).sum()), right, atol=1e-12)
    np.testing.assert_allclose(np.linalg.svd(found)[1], [1, 1, 0], atol=1e-12)


@pytest.mark.parametrize("sign", [1, -1])
def test_pose(sign):
    points = space()
    a, b = seen(FIRST, points), seen(SECOND, points)
    e = sign * cross(TRANSLATION) @ ROTATION
    pose = cvkern.recover_pose(e, a, b, CAMERA, OTHER)
    np.testing.assert_allclose(pose.rotation, ROTATION, atol=1e-12)
    length = np.linalg.norm(TRANSLATION)
    np.testing.assert_allclose(pose.translation, TRANSLATION / length, atol=1e-12)
    assert pose.inliers.all()
    assert pose.inliers.dtype == bool
    behind = points.copy()
    behind[:5] *= -1  # their images are as if they were in front of the first, not of the second
    b2 = seen(SECOND, behind)
    a2 = seen(FIRST, behind)
    again = cvkern.recover_pose(e, a2, b2, CAMERA, OTHER)
    np.testing.assert_allclose(again.rotation, ROTATION, atol=1e-12)
    assert not again.inliers[:5].any()
    assert again.inliers[5:].all()


def test_pose_from_matches_with_outliers():
    a, b, _ = scene(1, 500, 0.3, 0.3)
    fit = cvkern.find_fundamental(a, b)
    e = cvkern.essential_from_fundamental(fit.matrix, CAMERA, CAMERA)
    pose = cvkern.recover_pose(e, a[fit.inliers], b[fit.inliers], CAMERA, CAMERA)
    _, rotation, translation, _ = cv2.recoverPose(
        e, a[fit.inliers][:, ::-1].copy(), b[fit.inliers][:, ::-1].copy(), CAMERA
    )
    np.testing.assert_allclose(pose.rotation, rotation, atol=1e-9)
    np.testing.assert_allclose(pose.translation, translation[:, 0], atol=1e-9)
    angle = np.arccos((np.trace(pose.rotation @ ROTATION.T) - 1) / 2)
    assert np.degrees(angle) < 1
    assert pose.inliers.mean() > 0.95


@pytest.mark.parametrize("views", [2, 3])
def test_triangulation_of_exact_points(views):
    points = space()
    matrices = [FIRST, SECOND, THIRD][:views]
    images = np.stack([seen(m, points) for m in matrices])
    np.testing.assert_allclose(cvkern.triangulate(matrices, images), points, rtol=0, atol=1e-9)


@pytest.mark.parametrize("views", [2, 3])
def test_triangulation_is_optimal(views):
    points = space(12)
    matrices = np.stack([FIRST, SECOND, THIRD][:views])
    images = np.stack([seen(m, points) for m in matrices])
    images += np.random.default_rng(3).normal(0, 2, images.shape)
    found = cvkern.triangulate(matrices, images)
    for i in range(12):
        pairs = list(zip(matrices, images, strict=True))

        def gaps(x, i=i, pairs=pairs):
            return np.concatenate([seen(m, x[None])[0] - p[i] for m, p in pairs])

        best = scipy.optimize.least_squares(gaps, points[i], xtol=1e-15, ftol=1e-15, gtol=1e-15)
        assert np.sum(gaps(found[i]) ** 2) <= 2 * best.cost * (1 + 1e-9)
    if views == 2:  # OpenCV corrects the points to the nearest that meet, for the same optimum
        f = np.linalg.inv(OTHER).T @ cross(TRANSLATION) @ ROTATION @ np.linalg.inv(CAMERA)
        x, y = (p[None, :, ::-1].copy() for p in images)
        x, y = cv2.correctMatches(f, x, y)
        right = cv2.triangulatePoints(FIRST, SECOND, x[0].T, y[0].T)
        np.testing.assert_allclose(found, (right[:3] / right[3]).T, rtol=1e-5)


def test_points_that_views_do_not_see():
    points = space(5)
    matrices = [FIRST, SECOND, THIRD]
    images = np.stack([seen(m, points) for m in matrices])
    images[1, 2] = np.nan
    images[:2, 3] = np.nan
    found = cvkern.triangulate(matrices, images)
    assert np.isnan(found[3]).all()
    rest = np.array([0, 1, 2, 4])
    np.testing.assert_allclose(found[rest], points[rest], atol=1e-9)
    same = np.eye(3, 4)
    far = np.stack([seen(same, points)] * 2)
    assert cvkern.triangulate([same] * 2, far).shape == (5, 3)  # parallel rays: no error


def test_refusals():
    points = space(6)
    a, b = seen(FIRST, points), seen(SECOND, points)
    message = "K0 must have an inverse, got a matrix of rank below 3"
    flat = np.diag((1.0, 1, 0))
    refused(ValueError, message, cvkern.essential_from_fundamental, true_matrix(), flat, OTHER)
    message = "E must have shape (3, 3), got (3, 4)"
    refused(ValueError, message, cvkern.recover_pose, np.ones((3, 4)), a, b, CAMERA, OTHER)
    message = "points0 and points1 must be in front of both cameras, got none that is"
    e = cross(TRANSLATION) @ ROTATION
    refused(ValueError, message, cvkern.recover_pose, e, a * np.nan, b, CAMERA, OTHER)
    message = "points must have shape (V, N, 2) with V >= 2 as matrices have, 2, got (3, 6, 2)"
    refused(ValueError, message, cvkern.triangulate, [FIRST, SECOND], np.zeros((3, 6, 2)))
    message = "matrices must have shape (N, 3, 4), got (2, 3, 3)"
    refused(ValueError, message, cvkern.triangulate, np.ones((2, 3, 3)), np.zeros((2, 6, 2)))


@pytest.mark.parametrize(
    ("depth", "shift", "front"), [(3, -5, False), (8, -5, True), (-3, 5, False), (3, 5, True)]
)
def test_in_front_of_both_cameras(depth, shift, front):
    """A second camera ahead of the first one, or behind it."""
    point, t = np.array([0.3, 0.2, 1.0]) * depth, np.array([0.4, 0, shift])
    here, there = (q[None] / q[2] for q in (point, point + t))
    assert _in_front(here, there, np.eye(3), t).tolist() == [front]
