"""``cvkern scan`` on a rendered scanner."""

import numpy as np
import pytest

import cvkern
from cvkern.images import read_image, write_image
from tests.clouds.test_clouds import columns_of

SHAPE, PROJECTOR = (90, 120), (240, 320)


def written(folder, kind, lights):
    """Write the frames of a scan, and its calibration beside; return the scan."""
    scan = cvkern.make_scan(kind, SHAPE, PROJECTOR)
    (folder / "shots").mkdir()
    frames = [*scan.frames, scan.white, scan.black] if lights else scan.frames
    for n, frame in enumerate(frames):
        write_image(folder / "shots" / f"{n:02}.png", frame)
    cvkern.write_calibration(folder / "pair.json", scan.calibration)
    return scan


@pytest.mark.parametrize(("kind", "code"), [("gray_code", "gray"), ("phase_shift", "phase")])
def test_a_cloud(command, tmp_path, kind, code):
    scan = written(tmp_path, kind, lights=code == "gray")
    out = tmp_path / "out"
    words = ["scan", tmp_path / "shots", "--calibration", tmp_path / "pair.json", "-o", out,
             "--code", code]  # fmt: skip
    status, said, error = command(*words)
    assert status == 0, error
    depth = read_image(out / "depth.tif")
    known = np.isfinite(depth) & scan.lit
    assert known.sum() > 0.6 * scan.lit.sum()
    assert np.median(np.abs(depth - scan.points[..., 2])[known]) < 0.05
    cloud = columns_of(out / "cloud.ply")
    assert f"cloud.ply: {np.isfinite(depth).sum()} points" in said
    assert len(cloud["x"]) == np.isfinite(depth).sum()
    assert read_image(out / "columns.png").shape == (*SHAPE, 3)
    status, _, error = command(*words)
    assert (status, "output must have no results yet" in error) == (2, True)
    assert command(*words, "--overwrite")[0] == 0


def test_a_projector_above(command, tmp_path):
    """The scanner whose pictures have rows for columns: what was beside the camera is above it."""
    scan = cvkern.make_scan("gray_code", SHAPE, PROJECTOR)
    swap = np.eye(3)[[1, 0, 2]]
    left, right = (
        cvkern.Camera(
            swap @ c.matrix @ swap, c.distortion[[0, 1, 3, 2, 4]], (c.shape[1], c.shape[0])
        )
        for c in (scan.calibration.left, scan.calibration.right)
    )
    turned = scan.calibration._replace(
        left=left, right=right, rotation=swap @ scan.calibration.rotation @ swap,
        translation=swap @ scan.calibration.translation,
    )  # fmt: skip
    cvkern.write_calibration(tmp_path / "pair.yml", turned)
    columns = 2 * int(np.ceil(np.log2(PROJECTOR[1])))
    (tmp_path / "shots").mkdir()
    for n, frame in enumerate([*scan.frames[columns:], *scan.frames[:columns]]):
        write_image(tmp_path / "shots" / f"{n:02}.png", np.ascontiguousarray(frame.T))
    words = ["scan", tmp_path / "shots", "--calibration", tmp_path / "pair.yml", "-o",
             tmp_path / "out"]  # fmt: skip
    status, _, error = command(*words)
    assert status == 0, error
    depth = read_image(tmp_path / "out" / "depth.tif").T
    known = np.isfinite(depth) & scan.lit
    assert known.sum() > 0.6 * scan.lit.sum()
    assert np.median(np.abs(depth - scan.points[..., 2])[known]) < 0.05


def test_refusals(command, tmp_path):
    written(tmp_path, "gray_code", lights=False)
    words = ["scan", tmp_path / "shots", "--calibration", tmp_path / "pair.json", "-o",
             tmp_path / "out"]  # fmt: skip
    for more, said in (
        (["--code", "x"], "code must be one of ('gray', 'phase'), got 'x'"),
        (["--code", "phase", "--steps", 5], "folder must have 15 or 30 photographs"),
        (["--code", "phase", "--frequencies", "a"], "frequencies must be numbers, got 'a'"),
    ):
        status, _, error = command(*words, *more)
        assert (status, said in error) == (2, True), error
    (tmp_path / "shots" / "00.png").unlink()
    status, _, error = command(*words)
    assert status == 2
    assert "folder must have 18, 20 or 34, 36 photographs" in error
    write_image(tmp_path / "shots" / "00.png", np.zeros((9, 9), np.uint8))
    status, _, error = command(*words)
    assert (status, "folder must have photographs of (90, 120)" in error) == (2, True)
    status, _, error = command(*words, "--projector", "320")
    assert (status, "projector must be COLUMNSxROWS, 1920x1080 say, got '320'" in error) == (
        2,
        True,
    )
    assert not (tmp_path / "out").exists()
