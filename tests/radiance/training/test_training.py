"""Training of radiance fields: quality, equal runs, interrupts."""

import gc
import re
import threading
import weakref
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import cvkern
from cvkern.radiance import (
    HashField,
    VoxelField,
    cameras,
    evaluate,
    fit,
    load_model,
    make_scene,
    psnr,
    trainer,
    training,
)
from cvkern.radiance.march import SampledField
from cvkern.radiance.rendering import photograph
from cvkern.radiance.trainer import Trainer
from cvkern.radiance.training import KINDS, suited
from tests.radiance.runs import FIELDS, GRID, TINY, interrupt, press_ctrl_c, same


@pytest.fixture(scope="module")
def scene():
    return make_scene(train=16, test=2, size=24)


@pytest.mark.parametrize(
    ("field", "steps", "least"), [(TINY, 100, 17), (GRID, 120, 23)], ids=["hash", "voxel"]
)
def test_a_tiny_scene_is_learnt(backend, scene, field, steps, least):
    model = fit(scene, field, steps=steps, seed=1)
    found = evaluate(model, scene).psnr.mean()
    blank = [psnr(np.ones((24, 24, 3)), photograph(scene, v, np.ones(3)))
             for v in np.flatnonzero(scene.test).tolist()]  # fmt: skip
    assert model.training.marks[-1].test_psnr == found
    assert found > np.mean(blank) + 4  # an empty picture has about 11 dB
    assert found > least
    assert model.training.step == steps
    assert model.training.marks[-1].step == steps


@FIELDS
def test_unbounded_space(backend, scene, field):
    """As scenes of COLMAP and LLFF have it."""
    wide = replace(scene, bounds=scene.bounds._replace(unbounded=True))
    assert fit(wide, field, steps=40).training.marks[-1].test_psnr > 15  # the empty one has 11


def test_batches_grow(scene):
    """Rays fill the room for samples better once the field knows where it is empty."""
    model = fit(scene, TINY, steps=150)
    assert model.training.rays > model.field.first_rays


def test_rays_without_room_do_not_count(backend, scene, monkeypatch):
    """They saw nothing, but there was something to see."""
    monkeypatch.setattr(SampledField, "rays_for", lambda field, samples, rays: field.rays)
    looks, quality = [], Trainer.quality

    def look(self):
        found = quality(self)
        errors, spans = (self.rt.to_numpy(a).copy() for a in (self.errors, self.field.spans))
        looks.append((found, self.kept(), errors, spans))
        return found

    monkeypatch.setattr(Trainer, "quality", look)
    fit(scene, TINY, steps=32)
    found, kept, errors, spans = looks[-1]
    assert 0 < kept < TINY.rays
    assert (errors[:kept] > 0).mean() > 0.9
    assert (errors[kept:] == 0).all()
    assert (spans[kept:, 1] == 0).all()
    assert spans[:kept, 1].sum() > 0.5 * TINY.samples
    assert found == pytest.approx(-10 * np.log10(errors[:kept].mean()))


@pytest.mark.parametrize("step", [21, 32])
def test_going_on_with_batches_that_do_not_fit(scene, tmp_path, monkeypatch, step):
    monkeypatch.setattr(SampledField, "rays_for", lambda field, samples, rays: field.rays)
    options = {"steps": 40, "background": "learnt"}
    file = tmp_path / "model.npz"
    with monkeypatch.context() as patch:
        interrupt(patch, step, press_ctrl_c)
        stopped = fit(scene, TINY, checkpoint=file, **options)
    assert (stopped.training.step, stopped.training.rays < TINY.rays) == (step, step != 32)
    on = fit(scene, TINY, checkpoint=file, resume=True, **options)
    assert same(on, fit(scene, TINY, **options))


@FIELDS
def test_same_steps_give_the_same_model(backend, scene, field):
    first, second = (fit(scene, field, steps=20) for _ in range(2))
    assert same(first, second)
    assert not same(first, fit(scene, field, steps=20, seed=1))


@pytest.mark.parametrize("name", ["voxel", "hash", "mlp"])
def test_a_name_is_a_field_that_suits_the_device(scene, name):
    model = fit(scene, name, steps=1)
    assert type(model.settings) is KINDS[name]
    assert model.settings == suited(name)
    assert (model.settings == KINDS[name]()) == (name == "voxel")  # the others are for a GPU


def test_without_a_name_the_cpu_has_a_grid():
    assert suited() == VoxelField()


def test_a_gpu_has_a_table_or_a_finer_grid(monkeypatch):
    gpu = SimpleNamespace(device="cuda", free_memory=lambda: 12 * 10**9)
    monkeypatch.setattr(training, "runtime", lambda: gpu)
    assert suited() == HashField()
    grid = suited("voxel")
    assert isinstance(grid, VoxelField)
    assert grid.resolutions == (*VoxelField().resolutions, 256)
    gpu.free_memory = lambda: 8 * 10**9
    small = suited("voxel")
    assert isinstance(small, VoxelField)
    assert small == replace(grid, resolutions=(32, 64, 128), shares=(0.05, 0.15))


def test_ctrl_c_ends_the_looks_at_held_out_views(scene, tmp_path, monkeypatch):
    looked = []

    def look(*arguments, views):
        looked.append(views)
        press_ctrl_c()
        return evaluate(*arguments, views=views)

    monkeypatch.setattr(trainer, "evaluate", look)
    model = fit(scene, TINY, steps=3, checkpoint=tmp_path / "m.npz")
    assert len(looked) == 1  # there are two
    assert model.training.marks == []
    assert same(load_model(tmp_path / "m.npz"), model)


def test_a_second_ctrl_c_does_not_wait(scene, monkeypatch):
    def twice():
        press_ctrl_c()
        press_ctrl_c()

    interrupt(monkeypatch, 3, twice)
    with pytest.raises(KeyboardInterrupt):
        fit(scene, TINY, steps=10)


def test_seconds(scene):
    model = fit(scene, TINY, seconds=0.3)
    assert model.training.step >= 1
    assert model.training.seconds >= 0.3


def test_a_thread_of_its_own(scene):
    made = []
    thread = threading.Thread(target=lambda: made.append(fit(scene, TINY, steps=3)))
    thread.start()
    thread.join()
    assert same(made[0], fit(scene, TINY, steps=3))


def test_learnt_background(backend, scene):
    """Photographs without opacity, whose background is one colour."""
    color = np.array([0.15, 0.65, 0.8], np.float32)
    images = np.stack([photograph(scene, v, color) for v in range(len(scene))])
    opaque = replace(scene, images=np.round(255 * images).astype(np.uint8))
    model = fit(opaque, TINY, steps=120, background="learnt")
    # It begins with the colour of the borders, and the fog of the field moves it a little.
    assert np.abs(model.behind - color).max() < 0.02
    assert evaluate(model, opaque).psnr.mean() > 16


@pytest.mark.parametrize(("background", "behind"), [("black", 0), ("white", 1), ("random", 1)])
def test_backgrounds(scene, background, behind):
    model = fit(scene, TINY, steps=2, background=background)
    np.testing.assert_array_equal(model.behind, np.full(3, behind))


def test_losses(scene):
    squared, huber = (fit(scene, TINY, steps=64, loss=loss) for loss in ("squared", "huber"))
    assert not same(squared, huber)
    assert huber.training.marks[-1].test_psnr > 13


def test_marks_and_spread(scene):
    model = fit(scene, TINY, steps=40, evaluate_every=16, spread=1.0)
    assert [mark.step for mark in model.training.marks] == [16, 32, 40]
    seconds = [mark.seconds for mark in model.training.marks]
    assert seconds == sorted(seconds)
    assert not same(model, fit(scene, TINY, steps=40))


def test_no_views_kept_back(scene):
    model = fit(replace(scene, test=np.zeros(len(scene), bool)), TINY, steps=2)
    assert np.isnan(model.training.marks[-1].test_psnr)


@pytest.mark.parametrize("settings", [GRID, TINY], ids=["voxel", "hash"])
def test_a_model_goes_when_nobody_holds_it(scene, settings):
    """Not when Python comes to look for cycles, of which a GPU that is full knows nothing."""
    gc.disable()
    try:
        field = weakref.ref(fit(scene, settings, steps=3).field)
        assert field() is None
    finally:
        gc.enable()


def test_progress_bar(scene, monkeypatch, capsys):
    import rich.console

    monkeypatch.setattr(rich.console.Console, "is_terminal", True)
    fit(scene, TINY, steps=32)
    shown = capsys.readouterr().err
    assert re.search(r"\d\.\d dB  [\d,]+ k rays/s", shown)
    assert re.search(r"\d:\d\d:\d\d", shown)  # the time that is left
    fit(scene, TINY, steps=32, progress=False)
    assert capsys.readouterr() == ("", "")
    monkeypatch.setattr(rich.console.Console, "is_terminal", False)
    fit(scene, TINY, steps=32)
    assert capsys.readouterr() == ("", "")


# ------------------------------------------------------------------------------------------ errors


@pytest.mark.parametrize(
    ("options", "error", "rule"),
    [
        ({"seconds": -1}, ValueError, "seconds must be > 0, got -1"),
        ({"seconds": 0}, ValueError, "seconds must be > 0, got 0"),
        ({"seconds": float("nan")}, ValueError, "seconds must be finite, got nan"),
        ({"steps": 0}, ValueError, r"steps must be in \[1, .*\], got 0"),
        ({"steps": 1.5}, TypeError, "steps must be an integer, got 1.5"),
        ({"steps": 1, "seconds": 1}, ValueError, "seconds must not be given with steps"),
        ({"background": "blue"}, ValueError, "background must be one of .* got 'blue'"),
        ({"loss": "l7"}, ValueError, "loss must be one of .* got 'l7'"),
        ({"seed": -1}, ValueError, r"seed must be in \[0, .*\], got -1"),
        ({"spread": 2}, ValueError, r"spread must lie in \[0, 1\], got 2"),
        ({"save_every": 0}, ValueError, "save_every must be > 0"),
        ({"evaluate_every": 0}, ValueError, "evaluate_every must be in"),
        (
            {"field": "odd"},
            ValueError,
            "field must be one of .*'mlp'.*, got 'odd'",
        ),
        (
            {"field": 7},
            TypeError,
            "field must be settings such as .*, or a name, got 7",
        ),
        ({"field": HashField}, TypeError, "field must be settings .* got <class"),
        ({"checkpoint": "model.npy"}, ValueError, "path must end in .npz, got 'model.npy'"),
        ({"checkpoint": "none/m.npz"}, FileNotFoundError, "path must lie in a folder that exists"),
        ({"resume": True}, ValueError, "checkpoint must be given to resume from, got None"),
    ],
)
def test_errors_of_fit(scene, options, error, rule):
    with pytest.raises(error, match=rule):
        fit(scene, **options)


def test_scenes_that_cannot_be_trained_from(scene):
    with pytest.raises(ValueError, match="scene must have views to train from, got 18 held out"):
        fit(replace(scene, test=np.ones(len(scene), bool)), steps=1)
    with pytest.raises(TypeError, match="scene must be a Scene, got str: load_scene reads one"):
        fit("scene", steps=1)  # type: ignore[arg-type]
    wide = cameras(scene.cameras.poses, [1, 1, 0, 0], 2**15, 2**12)
    large = replace(
        scene, cameras=wide, images=np.broadcast_to(np.uint8(0), (18, 2**12, 2**15, 3)), depths=None
    )
    with pytest.raises(ValueError, match="scene must have images of less than 2 GiB in all, got"):
        fit(large, steps=1)
    model = fit(scene, TINY, steps=1)
    with pytest.raises(ValueError, match="scene must have views held out"):
        evaluate(model, replace(scene, test=np.zeros(len(scene), bool)))
    with pytest.raises(ValueError, match=r"views must be in \[0, 17\], got 99"):
        evaluate(model, scene, views=[99])


@pytest.mark.parametrize("name", ["fit", "make_scene"])
def test_what_is_not_kernels_alone_is_refused(scene, name):
    calls = {"fit": lambda image: fit(scene, TINY, steps=1), "make_scene": lambda _: make_scene()}
    with pytest.raises(ValueError, match=f"captured functions must be kernels alone, got {name}"):
        cvkern.capture(calls[name], np.zeros((4, 4), np.float32))
