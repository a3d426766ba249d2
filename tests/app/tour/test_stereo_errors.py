"""What the tour and the experiments say about errors of stereo."""

import json

import numpy as np
import pytest

from cvkern.app.tour import stereo_errors
from cvkern.images import read_image, write_image
from profiling.case import TOY
from profiling.cases.stereo import matching as pairs
from profiling.experiments import window_size


def test_bad_pixels():
    truth = np.array([[5.0, 5.0, 5.0, np.nan, np.inf]])
    disparity = np.array([[6.0, 6.01, np.nan, 5.0, 5.0]])
    np.testing.assert_array_equal(
        stereo_errors.bad(disparity, truth), [[False, True, True, False, False]]
    )


def test_occluded_pixels():
    truth = np.full((3, 30), 2.0)
    truth[:, 15:20] = 8.0  # seen at columns 7 to 11, in front of what is seen there at disparity 2
    truth[1, 25] = np.nan
    hidden = stereo_errors.occluded(truth)
    want = np.zeros((3, 30), bool)
    want[:, :2] = True  # outside of the right image
    want[:, 9:14] = True
    # The place of a surface is known to a column.
    assert (hidden >= want).all()
    assert (hidden & ~want).sum(1).max() <= 2


def test_rims_and_flat_surfaces():
    truth = np.full((20, 40), 3.0)
    truth[:, 20:] = 9.0
    truth[0] = np.inf
    rim = stereo_errors.rims(truth)
    assert not rim[0].any()
    np.testing.assert_array_equal(np.flatnonzero(rim[10]), range(16, 24))
    gray = np.random.default_rng(0).integers(0, 256, (20, 40)).astype(np.float32)
    gray[:, :20] = 77
    plain = stereo_errors.flat(gray)
    assert plain[:, :16].all()
    assert not plain[:, 20:].any()


def test_a_small_window_is_noisy_and_a_large_one_fattens(backend):
    left, right = pairs.pair(TOY, np.random.default_rng(0))
    truth = pairs.truth(TOY)
    windows = (1, 5, 31)
    maps, shares = stereo_errors.sweep(left, right, truth, (0, 16), windows)
    assert len(maps) == 3
    inside, rims = shares["textured surfaces"], shares["near rims"]
    assert inside[0] > 0.3
    assert inside[1] < 0.05
    assert rims[2] > 1.3 * rims[1]
    wrong = stereo_errors.bad(maps[1], truth)
    assert shares["all"][1] == wrong.sum() / np.isfinite(truth).sum()


@pytest.fixture
def folder(tmp_path):
    place = tmp_path / "stereo" / "boards"
    place.mkdir(parents=True)
    for name, view in zip(
        ("left", "right"), pairs.pair(TOY, np.random.default_rng(1)), strict=True
    ):
        write_image(place / f"{name}.png", view)
    truth = pairs.truth(TOY)
    np.savez(place / "disparity.npz", disparity=np.where(np.isnan(truth), np.inf, truth))
    (place / "meta.json").write_text(json.dumps({"ndisp": 16}))
    return tmp_path


def test_the_experiment_on_windows(folder, tmp_path, capsys):
    pytest.importorskip("matplotlib")
    command = [str(folder), "--output", str(tmp_path), "--window", "3", "9"]
    assert window_size.main(command) == 0
    result = json.loads((tmp_path / "window_size.json").read_text())
    assert result["windows"] == [3, 9]
    assert result["mean"] == result["pairs"]["boards"]
    said = capsys.readouterr().out
    assert f"{100 * result['mean']['all'][1]:.1f}" in said
    drawn = (tmp_path / "window_size.svg").read_text()
    assert "</svg>" in drawn
    assert window_size.main(command) == 0
    assert (tmp_path / "window_size.svg").read_text() == drawn


def test_the_experiment_without_pairs(tmp_path, capsys):
    assert window_size.main([str(tmp_path), "--output", str(tmp_path)]) == 2
    assert "folder must hold pairs under stereo" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_plots_are_pictures(tmp_path):
    pytest.importorskip("matplotlib")
    shares = {name: [0.5, 0.2] for name in ("near rims", "flat surfaces", "all")}
    (tmp_path / "plot.png").write_bytes(stereo_errors.plot((3, 9), shares))
    assert read_image(tmp_path / "plot.png").shape[:2] == (500, 740)
