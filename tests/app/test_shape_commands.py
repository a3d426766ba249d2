"""``cvkern lines``, ``cvkern circles`` and ``cvkern find``."""

import csv
import json

import numpy as np
import pytest

import cvkern
from cvkern.images import read_image, write_image
from tests.app.test_cli import GAUSSIAN, QUANTILES


def test_find(command, photo, tmp_path):
    image = read_image(photo)
    write_image(tmp_path / "shape.png", image[8:56, 10:60])
    table, poses = tmp_path / "found.csv", tmp_path / "found.json"
    words = "find", tmp_path / "shape.png", photo, "-o", tmp_path / "f.png"
    options = "--rotations", 4, "--scales", 0.9, 1.1, 0.1
    code, out, _ = command(*words, *options, "--csv", table, "--json", poses)
    assert code == 0
    found = cvkern.detect_shape(image[8:56, 10:60], image, rotations=4, scales=[0.9, 1.0, 1.1])
    assert "f.png: found 1 of shape.png\n" in out
    ((row, column),) = found.position
    assert abs(row - 31.5) < 0.1
    assert abs(column - 34.5) < 0.1
    assert f"row {row:.1f}, column {column:.1f}, rotation " in out
    (read,) = json.loads(poses.read_text())
    with table.open(newline="") as stream:
        (line,) = csv.DictReader(stream)
    assert list(line) == list(read) == ["row", "column", "rotation", "scale", "votes", "support"]
    want = (row, column, np.degrees(found.rotation[0]), found.scale[0], found.votes[0])
    for given in (line, read):
        values = [float(value) for value in given.values()]
        np.testing.assert_allclose(values, [*want, found.support[0]], rtol=1e-6, atol=1e-6)
    drawn = read_image(tmp_path / "f.png").astype(int)
    outline = (drawn == (255, 98, 41)).all(axis=2)  # its discs are a pixel in radius
    edges = cvkern.canny(image, 1.0, *QUANTILES, **GAUSSIAN)
    assert outline[edges].mean() > 0.9


def test_find_nothing(command, photo, tmp_path):
    write_image(tmp_path / "flat.png", np.full((40, 50), 7, np.uint8))
    table, poses = tmp_path / "found.csv", tmp_path / "found.json"
    code, out, _ = command(
        "find", photo, tmp_path / "flat.png", "-o", tmp_path / "f.png",
        "--csv", table, "--json", poses,
    )  # fmt: skip
    assert code == 0
    assert "found 0 of photo.png" in out
    assert table.read_text() == "row,column,rotation,scale,votes,support\n"
    assert json.loads(poses.read_text()) == []
    assert np.array_equal(read_image(tmp_path / "f.png"), read_image(tmp_path / "flat.png"))


@pytest.mark.parametrize(
    ("words", "rule"),
    [
        (
            ["--scales", "2", "1", "0.1"],
            "scales must be LOW <= HIGH and a STEP, all > 0, got 2 1 0.1",
        ),
        (["--scales", "1", "2", "0"], "scales must be LOW <= HIGH and a STEP, all > 0, got 1 2 0"),
        (["--rotations", "0"], "rotations must be in [1, 16384], got 0"),
        (["--csv", "photo.png"], "csv must not be a file that is read"),
        (["--csv", "o.txt", "--json", "o.txt"], "json must not be a file that is read, nor"),
    ],
)
def test_mistakes_of_find_write_nothing(command, photo, tmp_path, monkeypatch, words, rule):
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.iterdir())
    code, _, err = command("find", "photo.png", "photo.png", "-o", "f.png", *words)
    assert code == 2
    assert err.startswith(f"error: {rule}")
    assert sorted(tmp_path.iterdir()) == before


def test_circles(command, photo, tmp_path):
    files = {"csv": tmp_path / "circles.csv", "json": tmp_path / "circles.json"}
    code, out, _ = command(
        "circles", photo, "-o", tmp_path / "drawn.png", "--radius", 10, 30,
        "--csv", files["csv"], "--json", files["json"],
    )  # fmt: skip
    assert code == 0
    found = cvkern.detect_circles(read_image(photo), (10, 30))
    (row,) = json.loads(files["json"].read_text())
    want = (*found.centers[0].tolist(), *found.radii.tolist(), *found.support.tolist())
    assert tuple(row.values()) == want
    assert want[:3] == pytest.approx((31.3, 33.8, 18), abs=0.2)
    with files["csv"].open() as lines:
        (line,) = csv.DictReader(lines)
    assert list(line) == list(row) == ["row", "column", "radius", "support"]
    np.testing.assert_allclose([float(v) for v in line.values()], want, rtol=1e-6)
    assert "drawn.png: 1 circles\nrow 31.3" in out
    code, again, _ = command("circles", photo, "-o", tmp_path / "again.png")
    assert (code, len(cvkern.detect_circles(read_image(photo)).radii)) == (0, 1)
    assert "again.png: 1 circles\nrow 31.3" in again
    drawn = read_image(tmp_path / "drawn.png")
    assert drawn.shape == (60, 70, 3)
    assert (drawn[31, 51] != drawn[31, 51, 0]).any()  # on the circle, the colour


def test_circles_refused_leave_nothing(command, photo, tmp_path):
    out = tmp_path / "drawn.png"
    assert command("circles", photo, "-o", photo, "--radius", 10, 30)[0] == 2
    code, _, said = command("circles", photo, "-o", out, "--radius", 30, 10)
    assert code == 2
    assert "radius_range must rise, got 30 to 10" in said
    code, _, _ = command(
        "circles", photo, "-o", tmp_path / "a" / "drawn.png", "--radius", 10, 30,
        "--csv", tmp_path / "a.csv",
    )  # fmt: skip
    assert code == 2
    assert sorted(f.name for f in tmp_path.iterdir()) == ["photo.png"]


@pytest.mark.parametrize("whole", [False, True])
def test_lines(command, tmp_path, whole):
    step = np.full((60, 80), 40, np.uint8)
    step[:, 31:] = 190
    photo = tmp_path / "step.png"
    write_image(photo, step)
    files = {"csv": tmp_path / "lines.csv", "json": tmp_path / "lines.json"}
    code, out, _ = command(
        "lines", photo, "-o", tmp_path / "drawn.png", *(["--lines"] if whole else []),
        "--csv", files["csv"], "--json", files["json"],
    )  # fmt: skip
    assert code == 0
    (row,) = json.loads(files["json"].read_text())
    if whole:
        assert list(row) == ["theta", "rho", "votes"]
        assert list(row.values()) == pytest.approx([0, 30.5, 60], abs=0.05)
    else:
        assert list(row) == ["row", "column", "to_row", "to_column"]
        assert list(row.values()) == pytest.approx([0, 30.5, 59, 30.5], abs=0.05)
    with files["csv"].open() as lines:
        (line,) = csv.DictReader(lines)
    np.testing.assert_allclose([float(v) for v in line.values()], [*row.values()], rtol=1e-6)
    assert f"drawn.png: 1 {'lines' if whole else 'segments'}" in out
    coloured = np.ptp(read_image(tmp_path / "drawn.png").astype(int), axis=2) > 50
    assert coloured[1:-1, 30:32].all()
    assert not coloured[:, :28].any()
    assert not coloured[:, 34:].any()


def test_lines_refused_leave_nothing(command, photo, tmp_path):
    assert command("lines", photo, "-o", photo)[0] == 2
    code, _, said = command("lines", photo, "-o", tmp_path / "drawn.png", "--min-length", 0)
    assert code == 2
    assert "min_length must be > 0, got 0" in said
    assert sorted(f.name for f in tmp_path.iterdir()) == ["photo.png"]
