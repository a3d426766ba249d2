"""``cvkern match``: what it writes, says and refuses."""

import csv
import json

import numpy as np
import pytest
import skimage.data

import cvkern
from cvkern.images import read_image, write_image

MATRIX = np.array([[0.95, 0.1, 5], [-0.1, 0.95, 20], [1e-4, 0, 1]])


@pytest.fixture
def pair(tmp_path):
    """Write a photograph and the same through a homography, larger, in colour."""
    photo = skimage.data.camera()[100:300, 120:320]
    seen = cvkern.warp_perspective(photo, MATRIX, (230, 220), dtype=np.uint8)
    write_image(tmp_path / "a.png", photo)
    write_image(tmp_path / "b.png", np.repeat(seen[..., None], 3, axis=2))
    return tmp_path / "a.png", tmp_path / "b.png"


@pytest.mark.parametrize("method", ["sift", "orb"])
def test_match(command, pair, tmp_path, method):
    files = [tmp_path / f"out.{end}" for end in ("png", "csv", "json")]
    options = ["--csv", files[1], "--json", files[2], "--method", method]
    code, out, _ = command("match", *pair, "-o", files[0], *options)
    assert code == 0
    with files[1].open() as text:
        rows = np.array([[float(v) for v in row.values()] for row in csv.DictReader(text)])
    assert f"out.png: {len(rows)} matches of " in out
    beside = json.loads(files[2].read_text())
    np.testing.assert_allclose(rows, [list(row.values()) for row in beside], rtol=1e-6)
    there = np.c_[rows[:, 1::-1], np.ones(len(rows))] @ MATRIX.T
    off = there[:, :2] / there[:, 2:] - rows[:, :1:-1]
    assert (np.hypot(*off.T) < 3).sum() > 30
    assert (np.hypot(*off.T) < 3).mean() > 0.8
    assert read_image(files[0]).shape == (230, 420, 3)


def test_match_of_a_plane(command, pair, tmp_path):
    file = tmp_path / "out.json"
    code, out, _ = command("match", *pair, "-o", tmp_path / "o.png", "--json", file, "--plane")
    assert code == 0
    rows = np.array([list(row.values()) for row in json.loads(file.read_text())])
    assert f"{len(rows)} matches of one homography" in out
    there = np.c_[rows[:, 1::-1], np.ones(len(rows))] @ MATRIX.T
    off = there[:, :2] / there[:, 2:] - rows[:, :1:-1]
    assert len(off) > 200
    assert np.hypot(*off.T).max() < 3.1


def test_refusals(command, pair, tmp_path):
    code, _, error = command("match", *pair, "-o", pair[0])
    assert code != 0
    assert "output must not be a file that is read" in error
    code, _, error = command("match", *pair, "-o", tmp_path / "o.png", "--method", "surf")
    assert code != 0
    assert "method must be one of ('sift', 'orb'), got 'surf'" in error
    code, _, error = command("match", *pair, "-o", tmp_path / "o.png", "--plane", "--spread")
    assert code != 0
    assert "plane must be used with method sift" in error
    assert not (tmp_path / "o.png").exists()
