"""Calibration: rendered boards, OpenCV on the same points, SciPy's least squares."""

from typing import Any

import cv2
import numpy as np
import pytest
from scipy.optimize import least_squares

import cvkern
from cvkern.geometry.cameras import calibration
from cvkern.geometry.cameras.lens import turn_of, turned
from cvkern.images import read_image
from tests.refusals import refused
from tests.truth import truth

SHAPE = 480, 640
LENS = [-0.28, 0.11, 1.3e-3, -7e-4, -0.03]
LEFT = cvkern.Camera([[520, 0, 330], [0, 531, 236], [0, 0, 1]], LENS, SHAPE)
RIGHT = cvkern.Camera([[540, 0, 310], [0, 538, 246], [0, 0, 1]], [-0.2, 0.05, 0, 1e-3], SHAPE)
BOARD = cvkern.chessboard_points((6, 9), 30.0)
TURN, SHIFT = turned(np.array([0.02, -0.05, 0.01])), np.array([-90.0, 2, 5])


def views(count=8, noise=0.0, seed=0):
    """Return the corners of a board in both cameras, and its poses."""
    rng = np.random.default_rng(seed)
    turns = [turned(rng.uniform(-0.6, 0.6, 3) * (1, 1, 0.5)) for _ in range(count)]
    shifts = rng.uniform((-160, -110, 480), (-60, -50, 700), (count, 3))
    left = [cvkern.project_points(BOARD, LEFT, r, t) for r, t in zip(turns, shifts, strict=True)]
    right = [
        cvkern.project_points(BOARD, RIGHT, TURN @ r, TURN @ t + SHIFT)
        for r, t in zip(turns, shifts, strict=True)
    ]
    left, right = ([p + rng.normal(0, noise, p.shape) for p in v] for v in (left, right))
    return left, right, np.stack(turns), shifts


def for_cv2(points):
    return [np.ascontiguousarray(p[:, None, ::-1], np.float32) for p in points]


def test_points_without_noise_give_the_camera():
    left, _, turns, shifts = views()
    found = cvkern.calibrate_camera(BOARD, left, SHAPE)
    assert found.rms < 1e-8
    np.testing.assert_allclose(found.matrix, LEFT.matrix, rtol=0, atol=1e-5)
    np.testing.assert_allclose(found.distortion, LENS, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.rotations, turns, rtol=0, atol=1e-7)
    np.testing.assert_allclose(found.translations, shifts, rtol=0, atol=1e-4)
    assert found.camera.shape == SHAPE


@pytest.mark.parametrize(
    ("fixed", "flags"),
    [
        ((), 0),
        (("k3",), cv2.CALIB_FIX_K3),
        (("cx", "cy", "p1", "p2"), cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_ZERO_TANGENT_DIST),
    ],
)
def test_the_camera_is_that_of_opencv(fixed, flags):
    left = [p.astype(np.float32) for p in views(noise=0.3)[0]]  # the dtype in OpenCV
    found = cvkern.calibrate_camera(BOARD, left, SHAPE, fixed=fixed)
    board = [BOARD.astype(np.float32)] * len(left)
    stop = cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 300, 1e-15
    nothing: Any = None
    rms, matrix, lens, turns, shifts, spread, *_ = cv2.calibrateCameraExtended(
        board, for_cv2(left), SHAPE[::-1], nothing, nothing, flags=flags, criteria=stop
    )
    # The last step lowers the sum of 864 squares by 1e-12 of itself at most: each number is then
    # within sqrt(864) 1e-6 of its standard deviation, which is 1 for pixels and lengths at most.
    np.testing.assert_allclose(found.rms, rms, rtol=1e-9)
    np.testing.assert_allclose(found.matrix, matrix, rtol=0, atol=1e-4)
    np.testing.assert_allclose(found.distortion, lens.ravel()[:5], rtol=0, atol=1e-4)
    np.testing.assert_allclose(found.deviations, spread.ravel()[:9], rtol=1e-5, atol=1e-12)
    np.testing.assert_allclose(turn_of(found.rotations[2]), turns[2].ravel(), rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.translations[2], shifts[2].ravel(), rtol=0, atol=1e-4)


def test_a_camera_to_begin_with_is_kept_where_it_is_fixed():
    left, *_ = views(noise=0.1)
    found = cvkern.calibrate_camera(
        BOARD, left, SHAPE, camera=LEFT, fixed=("fx", "fy", "k1", "k2", "k3")
    )
    np.testing.assert_array_equal(np.diag(found.matrix), np.diag(LEFT.matrix))
    np.testing.assert_array_equal(found.distortion[[0, 1, 4]], np.array(LENS)[[0, 1, 4]])
    off = np.abs(found.matrix[:2, 2] - LEFT.matrix[:2, 2])
    assert (off < 4 * found.deviations[2:4]).all()
    np.testing.assert_array_equal(found.deviations == 0, [1, 1, 0, 0, 1, 1, 0, 0, 1])


def test_views_of_other_points():
    left, *_ = views(count=5, noise=0.2)
    some = [np.arange(54) % 7 != n for n in range(5)]
    found = cvkern.calibrate_camera(
        [BOARD[s] for s in some], [p[s] for p, s in zip(left, some, strict=True)], SHAPE
    )
    assert found.view_rms.shape == (5,)
    share = np.array([s.sum() for s in some]) / sum(s.sum() for s in some)
    np.testing.assert_allclose(np.sqrt(share @ found.view_rms**2), found.rms, rtol=1e-12)


def test_pairs_give_both_cameras():
    left, right, turns, _ = views()
    found = cvkern.calibrate_stereo(BOARD, left, right, SHAPE)
    assert found.rms < 1e-8
    np.testing.assert_allclose(found.right.distortion, RIGHT.distortion, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.rotation, TURN, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found.translation, SHIFT, rtol=0, atol=1e-5)
    np.testing.assert_allclose(found.rotations, turns, rtol=0, atol=1e-7)
    flat = [cvkern.undistort_points(p[0], c) for p, c in ((left, LEFT), (right, RIGHT))]
    assert cvkern.sampson_distance(found.fundamental, *flat).max() < 1e-6


@pytest.mark.parametrize("fixed", [False, True])
def test_pairs_are_as_good_as_those_of_scipy(fixed):
    """SciPy lowers the same squares, with slopes that it takes by differences."""
    left, right, *_ = views(count=4, noise=0.2)
    cameras: dict[str, Any] = {"left": LEFT, "right": RIGHT} if fixed else {}
    found = cvkern.calibrate_stereo(BOARD, left, right, SHAPE, fix_cameras=fixed, **cameras)

    def residuals(free):
        one, two = (
            (free[:9], free[9:18]) if not fixed else
            [np.array([*np.diag(c.matrix)[:2], *c.matrix[:2, 2], *c.distortion])
             for c in (LEFT, RIGHT)]
        )  # fmt: skip
        turn, shift = turned(free[18:21]), free[21:24]
        gaps = []
        for n, pose in enumerate(free[24:].reshape(-1, 6)):
            r, t = turned(pose[:3]), pose[3:]
            for numbers, seen, a, b in (
                (one, left[n], r, t), (two, right[n], turn @ r, turn @ t + shift),
            ):  # fmt: skip
                fx, fy, cx, cy = numbers[:4]
                camera = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
                shown = cv2.projectPoints(BOARD, a, b, camera, numbers[4:])[0][:, 0, ::-1]
                gaps.append((shown - seen).ravel())
        return np.concatenate(gaps)

    poses = [np.concatenate((turn_of(r), t)) for r, t in zip(found.rotations, found.translations,
                                                             strict=True)]  # fmt: skip
    numbers = [np.array([c.matrix[0, 0], c.matrix[1, 1], *c.matrix[:2, 2], *c.distortion])
               for c in (found.left, found.right)]  # fmt: skip
    begin = np.concatenate((*numbers, turn_of(found.rotation), found.translation, *poses))
    mine = np.sum(residuals(begin) ** 2)
    best = least_squares(residuals, begin + 1e-4 * np.abs(begin), x_scale="jac", xtol=1e-12)
    np.testing.assert_allclose(found.rms, np.sqrt(mine / (2 * 4 * 54)), rtol=1e-9)
    assert mine <= 2 * best.cost * (1 + 1e-7)
    np.testing.assert_allclose(found.translation, best.x[21:24], rtol=0, atol=0.02)


def test_photographs(backend):
    """13 pairs; OpenCV's best way, windows of 5, has 0.195, 0.207 and 0.217 pixels."""
    folder = truth("two_view") / "chessboard_stereo"
    board = cvkern.chessboard_points((6, 9))
    numbers = [path.stem[4:] for path in sorted(folder.glob("left[0-9]*.jpg"))]
    assert len(numbers) == 13
    left, right = (
        [cvkern.detect_chessboard(read_image(folder / f"{side}{n}.jpg"), (6, 9)) for n in numbers]
        for side in ("left", "right")
    )
    assert cvkern.calibrate_camera(board, left, (480, 640)).rms < 0.16
    assert cvkern.calibrate_camera(board, right, (480, 640)).rms < 0.155
    assert cvkern.calibrate_stereo(board, left, right, (480, 640)).rms < 0.175


def test_errors():
    left, right, *_ = views(count=3)
    one = (cvkern.calibrate_camera, BOARD)
    two = (cvkern.calibrate_stereo, BOARD)
    for said, function, *arguments, options in (
        ("image_points must have one view at least, got none", *one, [], SHAPE, {}),
        ("image_points must have points in each view, got None for view 1",
         *one, [left[0], None], SHAPE, {}),
        ("image_points[0] must have as many points as the board, 54, got 53",
         *one, [left[0][:-1]], SHAPE, {}),
        ("object_points must be of as many views as image_points, 3, got 2",
         cvkern.calibrate_camera, [BOARD, BOARD], left, SHAPE, {}),
        ("object_points must have Z = 0, got 1", cvkern.calibrate_camera,
         BOARD + np.array([0, 0, 1]), left, SHAPE, {}),
        ("image_points[0] must have 4 points at least, got 3",
         cvkern.calibrate_camera, BOARD[:3], [left[0][:3]], SHAPE, {}),
        ("image_points[2] must be finite, got some that are not",
         *one, [*left[:2], left[2] * np.nan], SHAPE, {}),
        ("image_points must be of 2 views at least to tell 4 numbers of a camera matrix, got 1: "
         "more views, or more in fixed", *one, left[:1], SHAPE, {}),
        ("image_points must be 14 points at least to tell 27 numbers, got 12",
         cvkern.calibrate_camera, BOARD[[0, 8, 45, 53]], [p[[0, 8, 45, 53]] for p in left], SHAPE,
         {}),
        ("fixed must be one of ('fx', 'fy', 'cx', 'cy', 'k1', 'k2', 'p1', 'p2', 'k3'), got 'f'",
         *one, left, SHAPE, {"fixed": ["f"]}),
        ("shape must be rows and columns of images, got 480", *one, left, 480, {}),
        ("right_points must be of as many views as left_points, 3, got 2",
         *two, left, right[:2], SHAPE, {}),
        ("shape must be rows and columns of corners, got (2, 2, 2)",
         cvkern.chessboard_points, (2, 2, 2), {}),
        ("square must be > 0, got 0", cvkern.chessboard_points, (2, 2), 0, {}),
    ):  # fmt: skip
        refused(ValueError, said, function, *arguments, **options)
    fold = cvkern.Camera(LEFT.matrix, [-1.0], SHAPE)
    refused(
        ValueError, "camera must see all points, got a lens that turns back before some",
        *one, [left[0] * 3], SHAPE, camera=fold, fixed=("fx", "fy", "cx", "cy"),
    )  # fmt: skip
    refused(TypeError, "camera must be a Camera, got int", *one, left, SHAPE, camera=3)
    refused(TypeError, "image_points must be a sequence of arrays, got 3", *one, 3, SHAPE)


def test_what_is_no_camera_is_refused_by_the_argument_it_was_found_from():
    with pytest.raises(ValueError, match="left_points must be of boards that a camera can see"):
        calibration.camera_of(np.array([-9.0, 9, 3, 4, 0, 0, 0, 0, 0]), (6, 8), "left_points")
