"""The quality of stereo: a pair against OpenCV, and the experiment."""

import json

import cv2
import numpy as np
import pytest
import skimage.data

import cvkern
from cvkern.images import write_image
from profiling.case import TOY
from profiling.cases.stereo import matching as pairs
from profiling.experiments import stereo_quality
from tests.stereo import reference_refinement as refinement


@pytest.fixture
def folder(tmp_path):
    place = tmp_path / "stereo" / "boards"
    place.mkdir(parents=True)
    views = pairs.pair(TOY, np.random.default_rng(1))
    for name, view in zip(("left", "right"), views, strict=True):
        write_image(place / f"{name}.png", view)
    truth = pairs.truth(TOY)
    np.savez(place / "disparity.npz", disparity=np.where(np.isnan(truth), np.inf, truth))
    (place / "meta.json").write_text(json.dumps({"ndisp": 16}))
    return tmp_path


def test_the_experiment_on_quality(folder, tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("CVKERN_COMMIT", "abc")  # a tree with changes records no results
    assert stereo_quality.main([str(folder), "--output", str(tmp_path)]) == 0
    result = json.loads((tmp_path / "stereo_quality.json").read_text())
    assert set(result["results"]) == set(stereo_quality.VERSIONS)
    found = result["results"]["as given"]
    assert set(found) == set(stereo_quality.MATCHERS)
    best = found["8 paths"]["boards"]
    assert best["bad-4"] <= best["bad-2"] <= best["bad-1"] < 10
    assert result["results"]["with noise"]["window 7"]["boards"]["bad-1"] > best["bad-1"]
    assert f"{best['bad-1']:.1f}" in capsys.readouterr().out


def test_scores():
    truth = np.full((4, 50), 5.0)
    truth[0] = np.inf
    disparity = np.full((4, 50), 5.25)
    disparity[1] = [5.0] * 20 + [6.5] * 20 + [8.0] * 10
    got = stereo_quality.scores(disparity, truth)
    assert got["bad-1"] == 20.0
    assert got["bad-2"] == round(1000 / 150, 2)
    assert got["bad-4"] == 0
    assert got["median"] == 0.25
    assert got["bad-1 seen by both"] == round(100 * 30 / 135, 2)  # five columns are not seen


def test_no_pairs(tmp_path, capsys):
    assert stereo_quality.main([str(tmp_path), "--output", str(tmp_path)]) == 2
    assert "folder must hold pairs under stereo" in capsys.readouterr().err


def test_the_motorcycle_of_scikit_image():
    """Below 8 % of bad pixels, with OpenCV's StereoSGBM on the same pair in the same run behind."""
    left, right, want = skimage.data.stereo_motorcycle()
    known, (width, stop) = np.isfinite(want), (left.shape[1], 64)
    found = cvkern.stereo_match(left, right, (0, stop), channel_axis=-1).disparity
    matcher = cv2.StereoSGBM.create(
        0, stop, 3, P1=8 * 3 * 9, P2=32 * 3 * 9, disp12MaxDiff=1, uniquenessRatio=10,
        speckleWindowSize=100, speckleRange=2, mode=cv2.StereoSGBM_MODE_HH,
    )  # fmt: skip
    # Columns in front let OpenCV see the whole image; what it leaves out is filled as ours is.
    wide = [cv2.copyMakeBorder(i, 0, 0, stop, 0, cv2.BORDER_REPLICATE) for i in (left, right)]
    theirs = matcher.compute(*wide)[:, stop:].astype(np.float32) / 16
    theirs = refinement.fill(np.where(theirs < 0, np.nan, theirs))[0]
    ours_bad, theirs_bad = (
        100 * (np.abs(disparity - want) > 1)[known].mean() for disparity in (found, theirs)
    )
    assert width == 741
    assert ours_bad < 8 < theirs_bad
