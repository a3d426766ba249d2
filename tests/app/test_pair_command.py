"""``cvkern pair``: what it writes, says and refuses."""

import json

import numpy as np
import pytest
import skimage.data

import cvkern
from cvkern.images import read_image, write_image

RESULTS = {"rectified.png", "sparse.png", "disparity.png", "depth.tif", "cloud.ply",
           "turntable.gif", "pair.json"}  # fmt: skip


@pytest.fixture(scope="module")
def photographs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("photographs")
    left, right, _ = skimage.data.stereo_motorcycle()
    for name, photo in (("a.png", left), ("b.png", right)):
        small = cvkern.resize(photo, (167, 247), channel_axis=-1)
        write_image(folder / name, np.rint(small).astype(np.uint8))
    return folder / "a.png", folder / "b.png"


def test_pair(command, photographs, tmp_path):
    target = tmp_path / "out"
    arguments = (*photographs, "-o", target, "--focal", 331.7, "--baseline", 0.193)
    code, out, _ = command("pair", *arguments)
    assert code == 0
    assert {path.name for path in target.iterdir()} == RESULTS
    assert "disparity.png: " in out
    assert read_image(target / "rectified.png").shape == (167, 494, 3)
    facts = json.loads((target / "pair.json").read_text())
    assert np.linalg.norm(facts["translation"]) == pytest.approx(0.193)
    assert facts["K"][0][0][0] == 331.7
    depth = read_image(target / "depth.tif")
    assert np.isfinite(depth).mean() > 0.4
    code, _, error = command("pair", *arguments)
    assert code == 2
    assert "output must have no results yet" in error
    assert "--overwrite replaces them" in error
    code, *_ = command("pair", *arguments, "--overwrite", "--max-side", 128)
    assert code == 0


def test_refusals(command, photographs, tmp_path):
    one, other = photographs
    for arguments, message in (
        ((one, other, "-o", one), "output must be a folder, got the file"),
        ((one, other, "-o", tmp_path / "o", "--focal", -1), "focal must be > 0, got -1"),
        ((one, tmp_path / "none.png", "-o", tmp_path / "o"), "none.png"),
    ):
        code, _, error = command("pair", *arguments)
        assert code == 2
        assert message in error
    assert not (tmp_path / "o").exists()
