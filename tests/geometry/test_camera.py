"""One camera: projection, the lens and its inverse, against OpenCV and closed forms."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cvkern
from cvkern.geometry._matrices import nearest_rotations
from cvkern.geometry.cameras.lens import turn_of, turned, turning_radius
from tests.refusals import refused

MATRIX = np.array([[520.0, 0, 318.25], [0, 530.5, 236.5], [0, 0, 1]])
LENS = [-0.28, 0.11, 1.3e-3, -7e-4, -0.02]
CAMERA = cvkern.Camera(MATRIX, LENS, (480, 640))


def scene(count=200, seed=0):
    return np.random.default_rng(seed).uniform((-2, -1.5, 3), (2, 1.5, 6), (count, 3))


def test_projection_is_that_of_opencv():
    turn, shift = np.array([0.2, -0.1, 0.3]), np.array([0.1, -0.2, 0.4])
    want = cv2.projectPoints(scene(), turn, shift, MATRIX, np.array(LENS))[0][:, 0, ::-1]
    for rotation in (turn, cv2.Rodrigues(turn)[0]):
        found = cvkern.project_points(scene(), CAMERA, rotation, shift)
        np.testing.assert_allclose(found, want, rtol=0, atol=1e-9)


def test_projection_and_its_inverse():
    """A lens-free camera of the same matrix sees the points where they are told to be."""
    plain = cvkern.Camera(MATRIX, shape=(480, 640))
    for number in range(5):  # each term by itself
        lens = np.where(np.arange(5) == number, LENS, 0)
        camera = cvkern.Camera(MATRIX, lens, (480, 640))
        found = cvkern.undistort_points(cvkern.project_points(scene(), camera), camera)
        np.testing.assert_allclose(found, cvkern.project_points(scene(), plain), rtol=0, atol=1e-6)


def test_nearest_rotations():
    """Turning the axes onto rows weighed alike is Wahba's problem; half of these are mirrored."""
    matrices = np.random.default_rng(0).normal(size=(20, 3, 3))
    assert 5 < (np.linalg.det(matrices) < 0).sum() < 15
    want = [Rotation.align_vectors(m.T, np.eye(3))[0].as_matrix() for m in matrices]
    np.testing.assert_allclose(nearest_rotations(matrices), want, rtol=0, atol=1e-12)
    np.testing.assert_allclose(nearest_rotations(matrices[0]), want[0], rtol=0, atol=1e-12)


def test_points_seen_by_a_turned_camera():
    turn = turned(np.array([0.05, -0.02, 0.1]))
    flat = cvkern.Camera([[400.0, 0, 300], [0, 400, 250], [0, 0, 1]], shape=(480, 640))
    seen = cvkern.project_points(scene(), CAMERA)
    found = cvkern.undistort_points(seen, CAMERA, flat.matrix, turn)
    np.testing.assert_allclose(found, cvkern.project_points(scene(), flat, turn), atol=1e-6)


def test_what_no_ray_shows_is_not_a_number():
    """Behind the camera; and beyond the radius where r (1 - r^2 / 3) turns back, which is 1."""
    assert np.isnan(cvkern.project_points([[0, 0, -1], [1, 1, 0]], CAMERA)).all()
    fold = cvkern.Camera(np.eye(3), [-1 / 3], (9, 9))
    found = cvkern.undistort_points([[0, 0.66], [0, 0.67], [0, 3.0]], fold)
    assert np.isfinite(found[0]).all()
    assert np.isnan(found[1:]).all()
    half = turned(np.array([0, 2.0, 0]))  # rays ahead end behind a camera turned by 115 degrees
    assert np.isnan(cvkern.undistort_points([[236, 318]], CAMERA, rotation=half)).all()


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.3, 3.1])
def test_turns_and_vectors(angle):
    vector = angle * np.array([2, -1, 2]) / 3
    np.testing.assert_allclose(turned(vector), cv2.Rodrigues(vector)[0], atol=1e-15)
    np.testing.assert_allclose(turn_of(turned(vector)), vector, atol=1e-9)


def test_lists_of_other_libraries_keep_their_library():
    torch = pytest.importorskip("torch")
    found = cvkern.project_points(torch.tensor([[0.0, 0, 2]]), CAMERA)
    assert isinstance(found, torch.Tensor)


def test_errors():
    refused(
        ValueError,
        "matrix must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], "
        "got [[1.0, 2.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]",
        cvkern.Camera, [[1, 2, 0], [0, 1, 0], [0, 0, 1]],
    )  # fmt: skip
    refused(
        ValueError, "matrix must have fx, fy > 0, got 0 and 1",
        cvkern.Camera, np.diag([0.0, 1, 1]),
    )  # fmt: skip
    refused(
        ValueError,
        "distortion must be k1, k2, p1, p2, k3 of OpenCV's lens, "
        "got 8 numbers, 1 more of them not 0",
        cvkern.Camera, np.eye(3), [0, 0, 0, 0, 0, 0, 0, 1],
    )  # fmt: skip
    refused(ValueError, "distortion must be finite, got [nan]", cvkern.Camera, np.eye(3), [np.nan])
    refused(
        ValueError, "shape must be rows and columns, got 3 numbers",
        cvkern.Camera, np.eye(3), [], (2, 2, 2),
    )  # fmt: skip
    refused(
        TypeError, "camera must be a Camera, got ndarray",
        cvkern.project_points, [[0, 0, 1]], np.eye(3),
    )  # fmt: skip
    refused(
        ValueError, "rotation must be a rotation, got "
        "[[2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]]",
        cvkern.project_points, [[0, 0, 1]], CAMERA, 2 * np.eye(3),
    )  # fmt: skip
    refused(
        ValueError, "rotation must have shape (3, 3) or (3,), got (4,)",
        cvkern.project_points, [[0, 0, 1]], CAMERA, np.zeros(4),
    )  # fmt: skip
    refused(
        ValueError, "translation must have shape (3,), got (2,)",
        cvkern.project_points, [[0, 0, 1]], CAMERA, np.eye(3), [0, 0],
    )  # fmt: skip
    refused(
        ValueError, "translation must be finite, got [0.0, 0.0, inf]",
        cvkern.project_points, [[0, 0, 1]], CAMERA, np.eye(3), [0, 0, np.inf],
    )  # fmt: skip


@pytest.mark.parametrize("lens", [(-0.2,), (0.1, -0.3), (0.2, -0.1, 0, 0, -0.05), (0, 0, 0, 0, -1)])
def test_a_lens_turns_back_where_its_slope_is_0(lens):
    lens = np.pad(np.array(lens, float), (0, 5 - len(lens)))
    r = np.linspace(0, 3, 300001)
    bend = r * (1 + lens[0] * r**2 + lens[1] * r**4 + lens[4] * r**6)
    first = r[np.argmax(np.diff(bend) < 0)]
    assert turning_radius(lens) == pytest.approx(first, abs=2e-5)
