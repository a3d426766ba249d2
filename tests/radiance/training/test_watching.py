"""What a training tells while it runs: to a function, to a table and to TensorBoard."""

import csv
import math
import sys
from types import ModuleType

import numpy as np
import pytest

from cvkern.radiance import fit, load_model, make_scene, render
from tests.radiance.runs import GRID, same


@pytest.fixture(scope="module")
def scene():
    return make_scene(train=6, test=2, size=16)


def table(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_a_callback_sees_the_training_and_does_not_change_it(scene):
    seen = []

    def look(step, loss, model):
        seen.append((step, loss, model, render(model, scene.cameras).color))

    model = fit(scene, GRID, steps=40, callback=look, progress=False)
    assert [step for step, *_ in seen] == [16, 32, 40]
    assert all(other is model for _, _, other, _ in seen)
    assert seen[0][1] > seen[-1][1] > 0
    assert not np.array_equal(seen[0][3], seen[-1][3])
    assert same(model, fit(scene, GRID, steps=40, progress=False))


def test_true_ends_the_training(scene, tmp_path):
    steps, file = [], tmp_path / "model.npz"

    def look(step, loss, model):
        steps.append(step)
        return step == 32

    model = fit(scene, GRID, steps=999, callback=look, checkpoint=file, progress=False)
    assert steps == [16, 32]
    assert (model.training.step, model.training.stopped) == (32, True)
    assert same(load_model(file), model)


def test_an_exception_comes_through(scene):
    def look(step, loss, model):
        raise KeyError("enough")

    with pytest.raises(KeyError, match="enough"):
        fit(scene, GRID, steps=40, callback=look, progress=False)


def test_a_log_goes_on_with_the_training(scene, tmp_path):
    log, file = tmp_path / "log.csv", tmp_path / "model.npz"
    options = {"checkpoint": file, "log": log, "progress": False}
    model = fit(scene, GRID, steps=36, evaluate_every=20, **options)
    rows = table(log)
    assert [int(row["step"]) for row in rows] == [16, 20, 32, 36]
    assert [bool(row["test_psnr"]) for row in rows] == [False, True, False, True]
    assert float(rows[-1]["test_psnr"]) == pytest.approx(model.training.marks[-1].test_psnr, 1e-5)
    for row in rows:
        assert float(row["psnr"]) == pytest.approx(-10 * math.log10(float(row["loss"])), 1e-4)
    assert float(rows[2]["rays_per_second"]) > 0
    seconds = [float(row["seconds"]) for row in rows]
    assert seconds == sorted(seconds)
    fit(scene, GRID, steps=50, resume=True, **options)
    assert [int(row["step"]) for row in table(log)] == [16, 20, 32, 36, 48, 50]
    fit(scene, GRID, steps=16, **options)
    assert [int(row["step"]) for row in table(log)] == [16]


def test_a_log_for_tensorboard(scene, tmp_path, monkeypatch):
    told = []

    class Writer:
        def __init__(self, folder):
            told.append(folder)

        def __enter__(self):
            return self

        def __exit__(self, *_):
            told.append("closed")

        def add_scalar(self, name, value, step):
            told.append((name, step, value))

    module = ModuleType("torch.utils.tensorboard")
    monkeypatch.setattr(module, "SummaryWriter", Writer, raising=False)
    for name in ("torch", "torch.utils"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", module)
    fit(scene, GRID, steps=16, log=tmp_path / "runs", progress=False)
    assert (told[0], told[-1]) == (str(tmp_path / "runs"), "closed")
    assert {name for name, *_ in told[1:-1]} >= {"loss", "psnr", "test_psnr"}


@pytest.mark.parametrize(
    ("options", "error", "rule"),
    [
        ({"callback": 3}, TypeError, "callback must be a function"),
        ({"log": "log.txt"}, ValueError, r"log must end in \.csv, or be a folder"),
        ({"log": 7}, TypeError, "log must be a string or a path"),
        ({"log": "nowhere/log.csv"}, FileNotFoundError, "log must lie in a folder that exists"),
        ({"log": "folder.csv"}, ValueError, "log must be a file"),
    ],
)
def test_errors(scene, tmp_path, monkeypatch, options, error, rule):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(error, match=rule):
        fit(scene, GRID, steps=1, **options)


def test_tensorboard_is_missing(scene, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", None)
    with pytest.raises(ModuleNotFoundError, match="a log for TensorBoard needs PyTorch"):
        fit(scene, GRID, steps=1, log=tmp_path / "runs")
