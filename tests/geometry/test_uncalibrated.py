"""Rectification without known cameras: rendered truth, photographs, pairs that cannot be."""

from typing import Any

import cv2
import numpy as np
import pytest

import cvkern
from cvkern.geometry.uncalibrated import _corners, _squared
from tests.geometry.reference_robust import ROTATION
from tests.geometry.test_epipolar import scene
from tests.refusals import refused
from tests.truth import truth

CAMERA = np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]])


def mapped(matrix, points):
    """Return (row, column) through a map of (x, y, 1)."""
    q = np.c_[points[:, ::-1], np.ones(len(points))] @ matrix.T
    return q[:, 1::-1] / q[:, 2:]


def area(matrix, shape):
    corners = np.array([[0, 0], [0, shape[1] - 1], [shape[0] - 1, shape[1] - 1], [shape[0] - 1, 0]])
    y, x = mapped(matrix, corners.astype(float)).T
    whole = (shape[0] - 1) * (shape[1] - 1)
    return (x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2 / whole


def fundamental(rotation, translation):
    x, y, z = translation
    inverse = np.linalg.inv(CAMERA)
    return inverse.T @ np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ rotation @ inverse


def turned(axis, angle):
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotation = np.eye(3)
    rotation[[i, i, j, j], [i, j, i, j]] = c, -s, s, c
    return rotation


@pytest.mark.parametrize(
    ("rotation", "translation"),
    [(np.eye(3), (1, 0, 0)), (np.eye(3), (-1, 0, 0)), (np.eye(3), (0, 1, 0)),
     (ROTATION, (1.0, 0.1, -0.2)), (turned(2, 0.5), (1, 0, 0)), (turned(2, np.pi), (1, 0.1, 0)),
     (turned(1, 0.3), (1, 0, 0.3)), (np.eye(3), (0.6, -0.5, 0.1))],
)  # fmt: skip
def test_matches_are_on_one_row(rotation, translation):
    """Also pictures on their sides and upside down; nothing is mirrored, shrunk or far away."""
    rng = np.random.default_rng(0)
    points = rng.uniform((-1.5, -1, 3), (1.5, 1, 6), (60, 3))
    a, b = ((q[:, 1::-1] / q[:, 2:]) for q in (
        points @ CAMERA.T, (points @ rotation.T + translation) @ CAMERA.T))  # fmt: skip
    f = fundamental(rotation, translation)
    H0, H1 = cvkern.rectify_uncalibrated(a, b, f, (480, 640))
    one, other = mapped(H0, a), mapped(H1, b)
    np.testing.assert_allclose(one[:, 0], other[:, 0], atol=1e-6)
    assert abs(np.median(one[:, 1] - other[:, 1])) < 1e-9
    sizes = area(H0, (480, 640)), area(H1, (480, 640))
    assert np.prod(sizes) == pytest.approx(1)
    assert min(sizes) > 0.5
    # The first picture is not upside down, and both are about where they were.
    right = mapped(H0, np.array([[240.0, 320], [240, 330]]))
    assert right[1, 1] > right[0, 1] - 1e-6
    middle = (mapped(H0, np.array([[239.5, 319.5]])) + mapped(H1, np.array([[239.5, 319.5]]))) / 2
    np.testing.assert_allclose(middle[0], (239.5, 319.5), atol=1e-6)


def test_of_matches_and_of_two_sizes():
    a, b, _ = scene(0, 300, 0.2, 0.3)
    fit = cvkern.find_fundamental(a, b / 2)
    inside = fit.inliers
    shapes = (480, 640), (240, 320)
    H0, H1 = cvkern.rectify_uncalibrated(a[inside], b[inside] / 2, fit.matrix, shapes)
    gaps = mapped(H0, a[inside])[:, 0] - mapped(H1, b[inside] / 2)[:, 0]
    assert np.abs(gaps).mean() < 0.5
    # The smaller picture is enlarged: both show the same things at the same size.
    assert area(H1, shapes[1]) > 1.5 * area(H0, shapes[0])


def test_photographs():
    """OpenCV's, with MAGSAC's matrix, has .41 px on the same matches."""
    photos: list[Any] = [
        cv2.imread(str(truth("two_view") / "kusvod2" / f"Leuven1{side}.jpg"), 0) for side in "AB"
    ]
    seen = [cv2.SIFT.create().detectAndCompute(photo, None) for photo in photos]
    matches = cv2.BFMatcher().knnMatch(seen[0][1], seen[1][1], k=2)
    good = [one for one, other in matches if one.distance < 0.8 * other.distance]
    a = np.array([seen[0][0][m.queryIdx].pt[::-1] for m in good])
    b = np.array([seen[1][0][m.trainIdx].pt[::-1] for m in good])
    shape = photos[0].shape
    order = np.random.default_rng(0).permutation(len(a))
    use, judge = np.array_split(order, 2)
    fit = cvkern.find_fundamental(a[use], b[use])
    inside = use[fit.inliers]
    H0, H1 = cvkern.rectify_uncalibrated(a[inside], b[inside], fit.matrix, shape)
    scale = (area(H0, shape) * area(H1, shape)) ** 0.25
    gaps = np.abs(mapped(H0, a[judge])[:, 0] - mapped(H1, b[judge])[:, 0]) / scale
    assert np.median(gaps) < 0.39


@pytest.mark.parametrize("translation", [(0.0, 0, 1), (0.3, 0.2, 1), (0.55, 0, 1)])
def test_epipoles_in_the_picture_are_refused(translation):
    """Forwards, and so far sideways that the epipole is just outside of the picture."""
    a = np.array([[100.0, 100]])
    message = (
        "F must have its epipoles outside of both pictures and not close to them, or "
        "rectifying folds a picture; got one for which it does"
    )
    f = fundamental(np.eye(3), translation)
    refused(ValueError, message, cvkern.rectify_uncalibrated, a, a, f, (480, 640))


def test_refusals():
    a = np.array([[100.0, 100]])
    f = fundamental(np.eye(3), (1, 0, 0))
    message = "F must be of rank 2, got a matrix of a lower rank"
    refused(ValueError, message, cvkern.rectify_uncalibrated, a, a, np.ones((3, 3)), (480, 640))
    message = "points0 and points1 must be finite and at least one, got others"
    refused(ValueError, message, cvkern.rectify_uncalibrated, a[:0], a[:0], f, (480, 640))
    refused(ValueError, message, cvkern.rectify_uncalibrated, a * np.nan, a, f, (480, 640))
    message = "shape must be rows and columns >= 2, of both images or each, got (480, 640, 3)"
    refused(ValueError, message, cvkern.rectify_uncalibrated, a, a, f, (480, 640, 3))
    message = "F must let both pictures keep their sizes"
    wide = np.diag((30.0, 30, 1)) @ f @ np.eye(3)
    with pytest.raises(ValueError, match=message):
        cvkern.rectify_uncalibrated(a, a, wide, (480, 640))


def test_the_middle_of_a_picture_stays_square():
    """Loop and Zhang 1999, 6: its axes stay at right angles, and in proportion."""
    width, height = 300.0, 120.0
    corners = _corners((width + 1, height + 1)) - [width / 2, height / 2, 0]
    h = np.array([[1.1, 0.3, 5], [0.05, 0.9, -3], [2e-4, 3e-4, 1]])
    left, right, top, bottom = (
        (q := _squared(h, corners) @ ((corners[i] + corners[j]) / 2))[:2] / q[2]
        for i, j in ((0, 2), (1, 3), (0, 1), (2, 3))
    )
    along, down = right - left, bottom - top
    assert abs(along @ down) < 1e-9 * np.linalg.norm(along) * np.linalg.norm(down)
    assert np.linalg.norm(along) / np.linalg.norm(down) == pytest.approx(width / height, rel=1e-9)
