"""From light to points in space: a rendered scanner with known truth, OpenCV's cameras."""

import cv2
import numpy as np
import pytest

import cvkern
from cvkern.geometry.cameras.lens import turned
from tests.refusals import refused

F32 = np.float32
SHAPE, PROJECTOR = (60, 80), (66, 90)


def pair(lens=(0.1, -0.05, 2e-3, -1e-3)):
    """Return a camera and a projector with strong lenses, neither square to the other."""
    left = cvkern.Camera([[90, 0, 41], [0, 92, 28], [0, 0, 1]], [-0.2, 0.1, 1e-3, 0, 0], SHAPE)
    right = cvkern.Camera([[100, 0, 47], [0, 99, 30], [0, 0, 1]], lens, PROJECTOR)
    turn, shift = turned(np.array([0.06, 0.2, 0.03])), np.array([-1.2, 0.9, 0.3])
    none = np.zeros((0, 3, 3)), np.zeros((0, 3))
    return cvkern.StereoCalibration(left, right, turn, shift, 0.0, *none, np.zeros(24))


def hill(calibration):
    """Return points (H, W, 3) of a hill on the camera's rays, and what lights them, by OpenCV."""
    y, x = np.indices(SHAPE)
    pixels = np.stack((y.ravel(), x.ravel()), axis=1).astype(float)
    rays = cvkern.undistort_points(pixels, calibration.left, np.eye(3))[:, ::-1]
    depth = 6 + np.exp(-((x - 40) ** 2 + (y - 30) ** 2) / 300).ravel() + 0.01 * x.ravel()
    points = depth[:, None] * np.column_stack((rays, np.ones(len(rays))))
    right = calibration.right
    seen = cv2.projectPoints(
        points, cv2.Rodrigues(calibration.rotation)[0], calibration.translation, right.matrix,
        right.distortion,
    )[0][:, 0]  # fmt: skip
    return points.reshape(*SHAPE, 3), seen[:, 0].reshape(SHAPE), seen[:, 1].reshape(SHAPE)


@pytest.mark.parametrize("axis", ["columns", "rows"])
@pytest.mark.parametrize("lens", [(), (0.1, -0.05, 2e-3, -1e-3)])
def test_points_are_where_they_were_made(backend, axis, lens):
    calibration = pair(lens)
    points, columns, rows = hill(calibration)
    places = (columns if axis == "columns" else rows).copy()
    inside = places > -0.5
    places[3, 4], places[5, 6] = np.nan, -1
    valid = np.ones(SHAPE, bool)
    valid[7] = False
    found = cvkern.triangulate_columns(places, calibration, valid, axis=axis)
    assert found.dtype == F32
    unknown = np.zeros(SHAPE, bool)
    unknown[3, 4] = unknown[5, 6] = unknown[7] = True
    known = np.isfinite(found).all(axis=2)
    np.testing.assert_array_equal(known, inside & ~unknown)
    # Places are rounded by 2^-18 (32 to 64), rays by 4 of those over 90; a column is 0.06 of depth.
    np.testing.assert_allclose(found[known], points[known], rtol=0, atol=1e-3)


def test_long_rows(backend):
    """A wall 6 away, seen by cameras without lenses; a row has several parts of 256 pixels."""
    cameras = [cvkern.Camera([[600, 0, c], [0, 600, 2], [0, 0, 1]], [0] * 5, (4, 700))
               for c in (300, 500)]  # fmt: skip
    none = np.zeros((0, 3, 3)), np.zeros((0, 3))
    shift = np.array([-1.0, 0, 0])
    rig = cvkern.StereoCalibration(
        cameras[0], cameras[1], np.eye(3), shift, 0.0, none[0], none[1], np.zeros(24)
    )
    y, x = np.indices((4, 700)).astype(float)
    found = cvkern.triangulate_columns(x - 300 - 600 / 6 + 500, rig)
    # Columns of up to 800 are rounded by 2^-15; a column is 0.06 of depth, and 0.04 of x.
    want = np.stack([(x - 300) / 100, (y - 2) / 100, np.full_like(x, 6)], 2)
    np.testing.assert_allclose(found, want, rtol=0, atol=1e-4)


def test_what_is_behind_is_nowhere():
    calibration = pair()
    _, columns, _ = hill(calibration)
    found = cvkern.triangulate_columns(np.full(SHAPE, 3000.0), calibration)
    assert np.isnan(found).any(axis=2).all()
    assert np.isfinite(cvkern.triangulate_columns(columns, calibration)).any()


def test_a_rendered_scanner_with_fringes(backend):
    scan = cvkern.make_scan("phase_shift", (90, 120))
    found = cvkern.decode_phase_shift(scan.frames, (240, 320))
    points = cvkern.triangulate_columns(found.columns, scan.calibration, found.valid)
    off = np.linalg.norm(points - scan.points, axis=2)
    known = np.isfinite(off) & scan.lit
    assert known.sum() > 0.9 * scan.lit.sum()
    # A column is 0.08 of depth; noise of 1 in 95 moves it by sqrt(2 / 4) / 95 / 2 pi / 64 of 320.
    assert np.median(off[known]) < 0.004
    assert np.quantile(off[known], 0.98) < 0.03


def test_a_rendered_scanner_with_gray_code(backend):
    scan = cvkern.make_scan("gray_code", (90, 120))
    found = cvkern.decode_gray_code(scan.frames, (240, 320), scan.white, scan.black)
    points = cvkern.triangulate_columns(found.columns, scan.calibration, found.valid)
    off = np.linalg.norm(points - scan.points, axis=2)
    known = np.isfinite(off) & scan.lit
    assert known.sum() > 0.7 * scan.lit.sum()
    assert np.median(off[known]) < 0.03  # half a column is 0.04 of depth
    assert np.quantile(off[known], 0.98) < 0.12


def test_a_wide_projector_lights_what_its_columns_reach():
    scan = cvkern.make_scan("gray_code", (60, 80), (40, 160), noise=0)
    stand = scan.calibration
    inside = scan.points[scan.lit] @ stand.rotation.T + stand.translation
    places = cvkern.project_points(inside, stand.right)
    assert ((places > -0.5) & (places < (39.5, 159.5))).all()
    assert places[:, 1].max() > 90


def test_a_rendered_turn_table():
    scan = cvkern.make_scan("laser", (120, 160), frames=12)
    lines = cvkern.detect_laser_lines(scan.frames, axis=1, sigma=1.0, threshold=40)
    points = cvkern.triangulate_lines(
        lines.positions, scan.calibration.left, scan.plane, axis=1, angles=scan.angles,
        pivot=scan.pivot, spindle=scan.spindle,
    )  # fmt: skip
    assert points.shape == (12, 120, 3)
    known = points[np.isfinite(points).all(axis=2)]
    assert len(known) > 600
    gaps = np.linalg.norm(known[:, None] - scan.balls[:, :3], axis=2) - scan.balls[:, 3]
    off = np.abs(gaps).min(axis=1)
    assert np.median(off) < 0.006
    assert np.quantile(off, 0.95) < 0.04
    aside = known[:, [0, 2]] - scan.pivot[[0, 2]]  # all the way round
    assert len(np.unique(np.floor(np.arctan2(*aside.T)))) >= 6


def test_the_plane_of_a_laser_from_a_board():
    rng = np.random.default_rng(0)
    camera = pair().left
    plane = np.array([0.9, 0.1, -0.2, 0.3])
    plane /= np.linalg.norm(plane[:3])
    turns = [turned(rng.uniform(-0.3, 0.3, 3)) for _ in range(3)]
    shifts = rng.uniform((-1, -1, 5), (1, 1, 8), (3, 3))
    lines = []
    for turn, shift in zip(turns, shifts, strict=True):
        # The two planes meet in a line: a point of it, and its direction.
        way = np.cross(plane[:3], turn[:, 2])
        point = np.linalg.solve([plane[:3], turn[:, 2], way], [plane[3], turn[:, 2] @ shift, 0])
        places = point + np.linspace(-1, 1, 40)[:, None] * way
        line = cvkern.project_points(places, camera)
        line[5] = np.nan
        lines.append(line)
    found = cvkern.fit_laser_plane(lines, camera, turns, shifts)
    np.testing.assert_allclose(found, plane, rtol=0, atol=1e-7)
    refused(
        ValueError, "lines must not lie on one line in space, got a board in one pose",
        cvkern.fit_laser_plane, lines[:1], camera, turns[:1], shifts[:1],
    )  # fmt: skip


def test_a_projector_is_found_from_a_board():
    """Codes of a plane that moves: the truth is OpenCV's projection, rounded to whole lines."""
    calibration = pair((0.02,))
    board = cvkern.chessboard_points((4, 5), 0.3) - np.array([0.6, 0.45, 0])
    corners, decoded = [], []
    for turn in ((0.4, 0, 0), (0, 0.4, 0.1), (-0.3, 0.2, 0), (0.2, -0.4, 0), (-0.3, -0.3, 0.3)):
        rotation, shift = turned(np.array(turn)), np.array([0.0, 0.1, 3.2])
        corners.append(cvkern.project_points(board, calibration.left, rotation, shift))
        pixels = np.indices(SHAPE).reshape(2, -1).T.astype(float)
        rays = cvkern.undistort_points(pixels, calibration.left, np.eye(3))[:, ::-1]
        rays = np.column_stack((rays, np.ones(len(rays))))
        points = rays * (rotation[:, 2] @ shift / (rays @ rotation[:, 2]))[:, None]
        lit = cvkern.project_points(
            points, calibration.right, calibration.rotation, calibration.translation
        )
        rows, columns = lit.reshape(*SHAPE, 2).round(1).transpose(2, 0, 1)
        dark = np.random.default_rng(len(decoded)).random(SHAPE) < 0.2
        columns[dark] = 3  # whatever an unlit pixel decodes to
        decoded.append(cvkern.GrayCode(columns, rows, np.isfinite(columns) & ~dark))
    found = cvkern.calibrate_projector(
        board, corners, decoded, SHAPE, PROJECTOR, camera=calibration.left,
        fixed=("k2", "k3", "p1", "p2"),
    )  # fmt: skip
    assert found.right.shape == PROJECTOR
    assert found.rms < 0.1
    np.testing.assert_allclose(found.right.matrix, calibration.right.matrix, rtol=0, atol=2)
    np.testing.assert_allclose(found.translation, calibration.translation, rtol=0, atol=0.05)
    one = cvkern.GrayCode(decoded[0].columns, None, decoded[0].valid)
    refused(
        ValueError, "decoded[0] must have columns and rows, got one of them",
        cvkern.calibrate_projector, board, corners, [one] * 5, SHAPE, PROJECTOR,
    )  # fmt: skip
    refused(
        ValueError, "decoded must be of as many views as image_points, 5, got 1",
        cvkern.calibrate_projector, board, corners, [one], SHAPE, PROJECTOR,
    )  # fmt: skip


def test_errors(no_kernel_runs):
    calibration, places = pair(), np.zeros(SHAPE)
    for error, said, *arguments, options in (
        (TypeError, "calibration must be a StereoCalibration, got int", places, 3, {}),
        (ValueError, "columns must have the shape of the camera, (60, 80), got (60, 81)",
         np.zeros((60, 81)), calibration, {}),
        (ValueError, "valid must have shape (60, 80), got (2, 2)",
         places, calibration, np.ones((2, 2)), {}),
        (ValueError, "axis must be one of ('columns', 'rows'), got 'x'",
         places, calibration, {"axis": "x"}),
    ):  # fmt: skip
        refused(error, said, cvkern.triangulate_columns, *arguments, **options)
    camera, plane = calibration.left, (1, 0, 0, 1)
    for said, *arguments, options in (
        ("positions must have 80 lines for axis 0, got 60", np.zeros(60), camera, plane, {}),
        ("angles and pivot must be given together, got one of them",
         np.zeros(80), camera, plane, {"angles": [0]}),
        ("angles must be of 1 frames, got 2",
         np.zeros(80), camera, plane, {"angles": [0, 1], "pivot": (0, 0, 1)}),
    ):  # fmt: skip
        refused(ValueError, said, cvkern.triangulate_lines, *arguments, **options)
    refused(
        ValueError, "kind must be one of ('gray_code', 'phase_shift', 'laser'), got 'x'",
        cvkern.make_scan, "x",
    )  # fmt: skip
