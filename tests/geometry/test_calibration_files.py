"""Calibrations in files: what is written is read, also by OpenCV; broken files are refused."""

import json
from typing import Any

import cv2
import numpy as np
import pytest

import cvkern
from tests.geometry.test_calibration import BOARD, SHAPE, views
from tests.refusals import refused

ENDINGS = ("json", "yml", "yaml")


def one():
    return cvkern.calibrate_camera(BOARD, views(count=3, noise=0.1)[0], SHAPE)


def two():
    return cvkern.calibrate_stereo(BOARD, *views(count=3, noise=0.1)[:2], SHAPE)


def same_camera(one, other):
    np.testing.assert_array_equal(one.matrix, other.matrix)
    np.testing.assert_array_equal(one.distortion, other.distortion)
    assert one.shape == other.shape


@pytest.mark.parametrize("ending", ENDINGS)
def test_what_is_written_is_read(tmp_path, ending):
    path = tmp_path / f"camera.{ending}"
    mine = one()
    cvkern.write_calibration(path, mine)
    found = cvkern.read_calibration(path)
    assert isinstance(found, cvkern.Calibration)
    same_camera(found.camera, mine.camera)
    assert found.rms == mine.rms
    np.testing.assert_array_equal(found.deviations, mine.deviations)
    pair = two()
    pair = pair._replace(right=cvkern.Camera(pair.right.matrix, pair.right.distortion, (7, 9)))
    cvkern.write_calibration(path, pair)
    again = cvkern.read_calibration(path)
    assert isinstance(again, cvkern.StereoCalibration)
    same_camera(again.left, pair.left)
    same_camera(again.right, pair.right)
    for name in ("rotation", "translation", "rms", "deviations"):
        np.testing.assert_array_equal(getattr(again, name), getattr(pair, name))


def test_opencv_reads_what_is_written(tmp_path):
    path, pair = tmp_path / "pair.yml", two()
    cvkern.write_calibration(path, pair)
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    for name, want in (
        ("M1", pair.left.matrix),
        ("D2", pair.right.distortion[None]),
        ("R", pair.rotation),
        ("T", pair.translation[:, None]),
    ):
        np.testing.assert_array_equal(file.getNode(name).mat(), want)
    assert file.getNode("image_width").real() == SHAPE[1]


@pytest.mark.parametrize("ending", ["yml", "xml", "json"])
def test_what_opencv_writes_is_read(tmp_path, ending):
    path, mine = tmp_path / f"camera.{ending}", one()
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    file.write("calibration_time", "Sun Nov 22 2026: noon")
    file.write("camera_matrix", mine.matrix)
    file.write("distortion_coefficients", mine.distortion[:, None])
    file.write("grid", np.zeros((40, 3)))
    file.release()
    refused(
        ValueError,
        f"{path}: no calibration: it does not say the size of the images, and shape is not given",
        cvkern.read_calibration, path,
    )  # fmt: skip
    found: Any = cvkern.read_calibration(path, SHAPE)
    same_camera(found.camera, mine.camera)
    assert np.isnan(found.rms)
    assert np.isnan(found.deviations).all()


@pytest.mark.parametrize("ending", ["yml", "xml", "json"])
@pytest.mark.parametrize(
    "names",
    ["M1 D1 M2 D2 R T", "cam1_intrinsics cam1_distorsion cam2_intrinsics cam2_distorsion R T",
     "cam_int cam_dist proj_int proj_dist roration translation"],  # codespell:ignore roration
)  # fmt: skip
def test_pairs_that_opencv_writes_under_several_names(tmp_path, ending, names):
    path, mine = tmp_path / f"pair.{ending}", two()
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    file.write("img_shape", np.array(SHAPE, np.float64))
    left, right = mine.left, mine.right
    numbers = (left.matrix, left.distortion[None], right.matrix, right.distortion[:, None],
               mine.rotation, mine.translation[:, None])  # fmt: skip
    for name, values in zip(names.split(), numbers, strict=True):
        file.write(name, values)
    file.release()
    found: Any = cvkern.read_calibration(path, right_shape=(600, 800))
    same_camera(found.left, mine.left)
    same_camera(found.right, cvkern.Camera(mine.right.matrix, mine.right.distortion, (600, 800)))
    np.testing.assert_array_equal(found.rotation, mine.rotation)
    np.testing.assert_array_equal(found.translation, mine.translation)
    read = cvkern.read_calibration(path)
    assert isinstance(read, cvkern.StereoCalibration)
    assert read.right.shape == SHAPE


GOOD = {
    "image_width": 8, "image_height": 6, "camera_matrix": np.eye(3).tolist(),
    "distortion_coefficients": [0.0],
}  # fmt: skip


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"camera_matrix": None}, "camera_matrix must have shape (3, 3), got ()"),
        ({"camera_matrix": [[1, 2], [3]]}, "setting an array element with a sequence"),
        ({"camera_matrix": np.diag([1, -1, 1]).tolist()}, "matrix must have fx, fy > 0"),
        ({"distortion_coefficients": ["a"]}, "could not convert string to float: 'a'"),
        ({"distortion_coefficients": [0] * 8 + [1]}, "distortion must be k1, k2, p1, p2, k3"),
        ({"image_width": 8.5}, "image_width and image_height must be whole, got 8.5"),
        ({"image_width": 0}, "shape must be in [1, 65536], got 0"),
        ({"M1": np.eye(3).tolist()}, "D1 is missing"),
        ({"M1": np.eye(3).tolist(), "D1": [0], "M2": np.eye(3).tolist(), "D2": [0],
          "R": np.zeros((3, 3)).tolist(), "T": [1, 0, 0]}, "rotation must be a rotation"),
        ({"M1": np.eye(3).tolist(), "D1": [0], "M2": np.eye(3).tolist(), "D2": [0],
          "R": np.eye(3).tolist(), "T": [0, 0, 0]}, "T must not be 0"),
    ],
)  # fmt: skip
def test_numbers_that_make_no_camera(tmp_path, change, said):
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(GOOD))
    cvkern.read_calibration(path)
    path.write_text(json.dumps({**GOOD, **change}))
    with pytest.raises(ValueError, match="no calibration: ") as info:
        cvkern.read_calibration(path)
    assert said in str(info.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "it does not begin with %YAML"),
        ("a: 1\n", "it does not begin with %YAML"),
        ("%YAML:1.0\n---\n", "it does not say the size of the images"),
        ("%YAML:1.0\nM1: !!opencv-matrix\n   rows: 3\n", "M1 is no whole matrix"),
        ("%YAML:1.0\nM1: !!opencv-matrix\n   rows: 1\n   cols: 3\n   dt: d\n   data: [ 1., 2. ]\n",
         "M1 must have 1 x 3 numbers, got 2"),
        ("<opencv_storage><M1>", "no element found"),
        ("<!DOCTYPE a []><opencv_storage/>", "it has a document type"),
        ("<calibration/>", "its root must be opencv_storage, got calibration"),
        ("<opencv_storage><M1 type_id='opencv-matrix'><rows>3</rows></M1></opencv_storage>",
         "M1 is no whole matrix"),
    ],
)  # fmt: skip
def test_broken_files(tmp_path, text, said):
    path = tmp_path / f"broken.{'xml' if text.startswith('<') else 'yml'}"
    path.write_text(text)
    with pytest.raises(ValueError, match="no calibration: ") as info:
        cvkern.read_calibration(path)
    assert said in str(info.value)


def test_files_that_are_none(tmp_path):
    (tmp_path / "a.json").write_text("[1]")
    (tmp_path / "b.json").write_bytes(b"\xff\xfe{")
    (tmp_path / "c.json").write_text("[" * 100_000)
    for name in ("a", "b", "c"):
        with pytest.raises(ValueError, match="no calibration: "):
            cvkern.read_calibration(tmp_path / f"{name}.json")
    with pytest.raises(FileNotFoundError):
        cvkern.read_calibration(tmp_path / "d.json")
    refused(
        ValueError, "path must end in .json, .yml, .yaml or .xml, got 'a.txt'",
        cvkern.read_calibration, "a.txt",
    )  # fmt: skip
    refused(
        ValueError, "path must end in .json, .yml or .yaml, got 'a.xml'",
        cvkern.write_calibration, "a.xml", one(),
    )  # fmt: skip
    refused(
        TypeError, "calibration must be a Calibration or a StereoCalibration, got int",
        cvkern.write_calibration, tmp_path / "d.json", 3,
    )  # fmt: skip
    assert not (tmp_path / "d.json").exists()
