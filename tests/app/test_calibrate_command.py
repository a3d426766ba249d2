"""``cvkern calibrate`` on rendered boards, and ``cvkern stereo`` with what it wrote."""

from typing import Any

import cv2
import numpy as np
import pytest

import cvkern
from cvkern.images import write_image
from tests.geometry.boards import View, render
from tests.stereo.test_calibrated import LEFT, calibration, frames

SHAPE = 4, 5
TILTS = ((0.5, 0.3), (0.6, 1.9), (0.5, 3.5), (0.6, 5.0))


@pytest.fixture(scope="module")
def pictures():
    return [picture for picture, _ in boards()]


def boards():
    """Return pictures of boards, with their corners."""
    views = (View(tilt, about, size=(130, 170), focal=260.0) for tilt, about in TILTS)
    for n, view in enumerate(views):
        picture, corners = render(SHAPE, view, square=17.0, seed=n)
        yield picture.round().clip(0, 255).astype(np.uint8), corners


def beside(picture, corners, way=0.5):
    """Return what a camera `way` squares to the right sees, four rows more below."""
    board = cvkern.chessboard_points(SHAPE)[:, :2]
    camera = np.array([[260, 0, 84.5], [0, 260, 64.5], [0, 0, 1]])
    pose = np.linalg.inv(camera) @ cv2.findHomography(board, corners[:, ::-1])[0]
    pose /= np.linalg.norm(pose[:, 0])
    moved = pose - [[0, 0, way], [0, 0, 0], [0, 0, 0]]
    mapped = camera @ moved @ np.linalg.inv(camera @ pose)
    return cv2.warpPerspective(picture, mapped, (170, 134), borderMode=cv2.BORDER_REPLICATE)


@pytest.fixture
def folder(tmp_path, pictures):
    for n, picture in enumerate(pictures):
        write_image(tmp_path / f"a{n}.png", picture)
    write_image(tmp_path / "b.png", np.zeros((130, 170), np.uint8))
    (tmp_path / "notes.txt").write_text("no photograph")
    return tmp_path


def test_one_camera(command, folder):
    output = folder / "camera.yml"
    words = ["calibrate", folder, "--board", "5x4", "-o", output, "--fixed", "k1,k2,k3,p1,p2"]
    code, said, _ = command(*words)
    assert code == 0
    assert "b.png: no whole board of 5x4 corners" in said
    assert "a0.png: 0.0" in said
    assert "4 of 5 photographs, 0.0" in said
    found: Any = cvkern.read_calibration(output)
    np.testing.assert_allclose(found.matrix[[0, 1], [0, 1]], 260, rtol=0.01)
    file = cv2.FileStorage(str(output), cv2.FILE_STORAGE_READ)
    np.testing.assert_array_equal(file.getNode("camera_matrix").mat(), found.matrix)
    code, _, said = command(*words)
    assert code == 2
    assert "output must be a new file" in said
    assert command(*words, "--overwrite")[0] == 0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--board", "5"], "board must be COLUMNSxROWS, 9x6 say, each at least 2, got '5'"),
        (["--board", "5x1"], "board must be COLUMNSxROWS"),
        (["--board", "5x4", "--left", "c*"], "folder must have photographs named c*"),
        (["--board", "5x4", "--left", "b*"],
         "board must be seen as a whole, 5x4 corners where four squares meet, in at least 2 "
         "photographs, got 0 of 1"),
        (["--board", "5x4", "--left", "*[b0].png"],
         "in at least 2 photographs, got 1 of 2: a0.png"),
        (["--board", "5x4", "--left", "a*", "--right", "b*"],
         "left and right must match as many photographs, got 4 and 1"),
        (["--board", "5x4", "--fixed", "f"], "fixed must be one of"),
    ],
)  # fmt: skip
def test_refusals(command, folder, words, said):
    code, _, error = command("calibrate", folder, "-o", folder / "camera.json", *words)
    assert code == 2
    assert said in error
    assert not (folder / "camera.json").exists()


def test_strangers_and_broken_photographs_are_named_and_left_out(command, folder, pictures):
    code, _, error = command("calibrate", folder, "--board", "5x4", "-o", folder / "a.txt")
    assert (code, "output must end in .json, .yml or .yaml" in error) == (2, True)
    write_image(folder / "c.png", np.zeros((10, 10), np.uint8))
    write_image(folder / "d.png", np.pad(pictures[0], 20, constant_values=200))
    (folder / "a1.png").write_bytes((folder / "a1.png").read_bytes()[:2000])
    (folder / "e.jpg").write_text("no photograph")
    words = ["calibrate", folder, "--board", "5x4", "-o", folder / "a.json"]
    code, said, _ = command(*words, "--fixed", "k1,k2,k3,p1,p2")
    assert code == 0
    for line in (
        "a1.png: left out: path must be a readable image",
        "b.png: no whole board of 5x4 corners",
        "c.png: no whole board of 5x4 corners",
        "d.png: left out: its size is (170, 210), that of most (130, 170)",
        "e.jpg: left out: path must be a readable image",
        "3 of 8 photographs, 0.0",
    ):
        assert line in said


def test_pairs_go_by_what_stands_for_the_star(command, tmp_path):
    for n, (picture, corners) in enumerate(boards()):
        write_image(tmp_path / f"left{n}.png", picture)
        write_image(tmp_path / f"right{n}.png", beside(picture, corners))
    (tmp_path / "left1.png").unlink()
    words = ["calibrate", tmp_path, "--board", "5x4", "-o", tmp_path / "a.json", "--left", "left*",
             "--right", "right*", "--fixed", "k1,k2,k3,p1,p2"]  # fmt: skip
    code, said, _ = command(*words)
    assert code == 0
    assert "right1.png: no partner" in said
    assert "3 of 3 pairs, 0." in said
    found: Any = cvkern.read_calibration(tmp_path / "a.json")
    assert (found.left.shape, found.right.shape) == ((130, 170), (134, 170))
    # A tenth of a pixel in a square of 17, some times more across the tilted boards' own error.
    np.testing.assert_allclose(found.translation, (-0.5, 0, 0), atol=0.05)


def test_raw_pictures_of_a_pair(command, tmp_path):
    for name, image in zip(("left", "right"), frames(), strict=True):
        write_image(tmp_path / f"{name}.png", image)
    file, out = tmp_path / "pair.json", tmp_path / "out"
    cvkern.write_calibration(file, calibration())
    words = ["stereo", tmp_path / "left.png", tmp_path / "right.png", "-o", out,
             "--max-disparity", 24, "--calibration", file]  # fmt: skip
    code, said, _ = command(*words)
    assert code == 0
    assert (out / "cloud.ply").exists()
    near, far = (float(v) for v in said.split("depth.tif: ")[1].split("\n")[0].split(" to "))
    assert 2.5 < near < far < 12  # the wall is 4 to 7 away
    code, _, error = command(*words, "--overwrite", "--focal", 100, "--baseline", 1)
    assert code == 2
    assert "calibration must go without focal" in error
    board = cvkern.chessboard_points((3, 4))
    views = [cvkern.project_points(board, LEFT, (t, 0.2 - t, 0), (-1, -1, 6)) for t in (0.4, -0.3)]
    cvkern.write_calibration(file, cvkern.calibrate_camera(
        board, views, LEFT.shape, fixed=("k1", "k2", "k3", "p1", "p2")))  # fmt: skip
    code, _, error = command(*words, "--overwrite")
    assert (code, "calibration must be of two cameras, got one" in error) == (2, True)
