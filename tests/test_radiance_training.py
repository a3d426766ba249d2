"""Training of radiance fields: quality, equal runs, checkpoints, interrupts."""

import errno
import os
import signal
import threading
import zipfile
from dataclasses import replace

import numpy as np
import pytest

import cvkern
from cvkern.radiance import (
    HashField,
    VoxelField,
    evaluate,
    fit,
    load_model,
    make_scene,
    psnr,
    render,
)
from cvkern.radiance.rendering import photograph
from cvkern.radiance.training import Trainer

TINY = HashField(
    levels=8, table_bits=12, coarsest=8, finest=64, samples=2**12, rays=2**9, cells=32
)  # fmt: skip


GRID = VoxelField(resolutions=(16, 32), shares=(0.3,), rays=2**9)
FIELDS = pytest.mark.parametrize("field", [TINY, GRID], ids=["hash", "voxel"])


@pytest.fixture(scope="module")
def scene():
    return make_scene(train=16, test=2, size=24)


def same(a, b):
    """Whether two models have the same parameters, bit for bit."""
    a, b = a.field.state(), b.field.state()
    return a.keys() == b.keys() and all(np.array_equal(a[name], b[name]) for name in a)


def interrupt(monkeypatch, step, how):
    """Call `how` after so many steps."""
    repeat = Trainer.repeat

    def interrupted(self):
        repeat(self)
        if self.model.training.step + 1 == step:
            how()

    monkeypatch.setattr(Trainer, "repeat", interrupted)


def press_ctrl_c():
    os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.parametrize(
    ("field", "steps", "least"), [(TINY, 150, 17), (GRID, 300, 23)], ids=["hash", "voxel"]
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


def test_batches_grow(scene):
    """Rays fill the room for samples better once the field knows where it is empty."""
    model = fit(scene, TINY, steps=150)
    assert model.training.rays > model.field.first_rays


@FIELDS
def test_same_steps_give_the_same_model(backend, scene, field):
    first, second = (fit(scene, field, steps=35) for _ in range(2))
    assert same(first, second)
    assert not same(first, fit(scene, field, steps=35, seed=1))


@FIELDS
@pytest.mark.parametrize("step", [21, 32])
def test_ctrl_c_stops_saves_and_can_go_on(backend, scene, tmp_path, monkeypatch, step, field):
    file = tmp_path / "model.npz"
    options = {"steps": 48, "background": "learnt"}
    straight = fit(scene, field, **options)
    with monkeypatch.context() as patch:
        interrupt(patch, step, press_ctrl_c)
        stopped = fit(scene, field, checkpoint=file, **options)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert stopped.training.stopped
    assert stopped.training.step == step
    assert same(load_model(file), stopped)
    on = fit(scene, field, checkpoint=file, resume=True, **options)
    assert not on.training.stopped
    assert on.training.step == 48
    assert same(on, straight)
    np.testing.assert_array_equal(on.behind, straight.behind)
    assert on.training.marks[-1][2:] == straight.training.marks[-1][2:]


def test_a_second_ctrl_c_does_not_wait(scene, monkeypatch):
    def twice():
        press_ctrl_c()
        press_ctrl_c()

    interrupt(monkeypatch, 3, twice)
    with pytest.raises(KeyboardInterrupt):
        fit(scene, TINY, steps=10)


def test_a_killed_run_goes_on(scene, tmp_path, monkeypatch):
    class Killed(BaseException):
        pass

    def kill():
        raise Killed

    file = tmp_path / "model.npz"
    with monkeypatch.context() as patch:
        interrupt(patch, 40, kill)
        with pytest.raises(Killed):
            fit(scene, TINY, steps=48, checkpoint=file, save_every=1e-6)
    assert load_model(file).training.step == 32
    on = fit(scene, TINY, steps=48, checkpoint=file, resume=True)
    assert same(on, fit(scene, TINY, steps=48))
    again = fit(scene, TINY, steps=48, checkpoint=file, resume=True)  # nothing is left to do
    assert (again.training.step, again.training.marks) == (48, on.training.marks)
    assert [file.name for file in tmp_path.iterdir()] == ["model.npz"]


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
    # It began at one half. The field holds it back a little: it has to clear away its fog first.
    assert np.abs(model.behind - color).max() < 0.12
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


def test_progress_bar(scene, monkeypatch, capsys):
    import rich.console

    monkeypatch.setattr(rich.console.Console, "is_terminal", True)
    fit(scene, TINY, steps=32)
    assert "dB" in capsys.readouterr().err
    fit(scene, TINY, steps=32, progress=False)
    assert capsys.readouterr() == ("", "")
    monkeypatch.setattr(rich.console.Console, "is_terminal", False)
    fit(scene, TINY, steps=32)
    assert capsys.readouterr() == ("", "")


# ------------------------------------------------------------------------------------ checkpoints


@pytest.fixture(scope="module")
def model(scene):
    return fit(scene, TINY, steps=20, background="learnt")


def test_saved_models_render_the_same(backend, scene, tmp_path):
    model = fit(scene, TINY, steps=20)
    model.save(tmp_path / "model.npz")
    read = load_model(tmp_path / "model.npz")
    assert same(read, model)
    assert read.settings == TINY
    assert read.frame == model.frame
    assert read.training == model.training
    for name in ("poses", "intrinsics", "distortion"):
        # The poses are made rotations again, which rounds.
        np.testing.assert_allclose(
            getattr(read.cameras, name), getattr(model.cameras, name), atol=1e-12
        )
    before, after = (render(m, scene.cameras, 3) for m in (model, read))
    for a, b in zip(before, after, strict=True):
        np.testing.assert_array_equal(a, b)


@FIELDS
def test_models_for_rendering_alone(scene, tmp_path, field):
    model = fit(scene, field, steps=20)
    model.save(tmp_path / "whole.npz")
    model.save(tmp_path / "small.npz", resumable=False)
    small, whole = ((tmp_path / f"{name}.npz").stat().st_size for name in ("small", "whole"))
    assert small < 0.6 * whole
    read = load_model(tmp_path / "small.npz")
    for a, b in zip(
        render(read, scene.cameras, 3), render(model, scene.cameras, 3), strict=True
    ):  # fmt: skip
        np.testing.assert_array_equal(a, b)
    read.save(tmp_path / "again.npz")
    for name in ("small.npz", "again.npz"):
        with pytest.raises(ValueError, match="checkpoint must be saved to go on with, got"):
            fit(scene, field, steps=30, checkpoint=tmp_path / name, resume=True)


def test_models_go_from_one_kernel_set_to_the_other(model, scene, tmp_path):
    model.save(tmp_path / "model.npz")
    with cvkern.use(backend="taichi"):
        other = render(load_model(tmp_path / "model.npz"), scene.cameras, 3)
    # Sums of up to 64 products in float32, in another order, then some 100 samples a ray.
    np.testing.assert_allclose(other.color, render(model, scene.cameras, 3).color, atol=1e-4)


def test_nothing_is_pickled(model, tmp_path):
    model.save(tmp_path / "model.npz")
    with np.load(tmp_path / "model.npz", allow_pickle=False) as file:
        assert all(file[name].dtype.kind in "uif" for name in file.files)


def test_files_cut_short(model, tmp_path):
    model.save(tmp_path / "model.npz")
    whole = (tmp_path / "model.npz").read_bytes()
    for share in (0.0, 0.001, 0.3, 0.7, 0.99):
        (tmp_path / "short.npz").write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(ValueError, match=r"path must be a whole model, got .*short.npz"):
            load_model(tmp_path / "short.npz")


def test_files_damaged(model, tmp_path):
    model.save(tmp_path / "model.npz")
    whole = bytearray((tmp_path / "model.npz").read_bytes())
    whole[len(whole) // 2] ^= 0xFF  # within an array: its checksum fails
    (tmp_path / "model.npz").write_bytes(whole)
    with pytest.raises(ValueError, match="path must be a whole model"):
        load_model(tmp_path / "model.npz")


def rewritten(source, target, **changes):
    """Write a model again with other arrays; None leaves one out."""
    with np.load(source) as file:
        arrays = dict(file.items())
    arrays |= changes
    np.savez(target, **{k: a for k, a in arrays.items() if a is not None})
    return target


def edited(source, old, new):
    """Return the header of a model with another text in it."""
    with np.load(source) as file:
        text = file["header"].tobytes()
    assert old.encode() in text
    return np.frombuffer(text.replace(old.encode(), new.encode()), np.uint8)


def test_wrong_versions_shapes_and_names(model, tmp_path):
    source, target = tmp_path / "model.npz", tmp_path / "other.npz"
    model.save(source)
    for old, new, rule in (
        ('"version": 1', '"version": 2', "of version 1, got 'cvkern radiance field' of version 2"),
        ("cvkern radiance field", "something else", "got 'something else'"),
        ('"HashField"', '"NoField"', "field must be one of"),
        ('"table_bits": 12', '"table_bits": 11', "table.values must have shape"),
        ('"cells": 32', '"cells": 64', "occupancy.density must have shape"),
        ('"levels"', '"stories"', "stories"),
        ('"near"', '"far_off"', "no 'near'"),
    ):
        header = edited(source, old, new)
        with pytest.raises(ValueError, match=rule):
            load_model(rewritten(source, target, header=header))
    for name, rule in (("state.layers.mean", "state must have 'layers.mean'"), ("header", "header"),
                       ("behind", "no 'behind'")):  # fmt: skip
        with pytest.raises(ValueError, match=rule):
            load_model(rewritten(source, target, **{name: None}))
    with pytest.raises(ValueError, match=r"layers\.mean must have shape"):
        load_model(rewritten(source, target, **{"state.layers.mean": np.zeros(3, np.float32)}))
    with pytest.raises(ValueError, match="path must be a whole model"):  # a pickled object
        load_model(rewritten(source, target, behind=np.array([None, {}], object)))


def test_files_of_other_kinds(tmp_path):
    file = tmp_path / "model.npz"
    with pytest.raises(FileNotFoundError, match="path must be a file that exists"):
        load_model(file)
    np.savez(file, a=np.zeros(3))
    with pytest.raises(ValueError, match="path must be a whole model"):
        load_model(file)
    file.write_text("words")
    with pytest.raises(ValueError, match="path must be a whole model"):
        load_model(file)
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("header.npy", "not an array")
    with pytest.raises(ValueError, match="path must be a whole model"):
        load_model(file)


def test_a_full_disk(model, scene, tmp_path, monkeypatch):
    file = tmp_path / "model.npz"
    model.save(file)
    before = file.read_bytes()

    write = np.lib.format.write_array

    def full(stream, array, **options):
        if array.nbytes > 1000:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        write(stream, array, **options)

    monkeypatch.setattr(np.lib.format, "write_array", full)
    with pytest.raises(OSError, match="No space left on device"):
        model.save(file)
    with pytest.raises(OSError, match="No space left on device"):
        fit(scene, TINY, steps=2, checkpoint=file)
    assert file.read_bytes() == before
    assert list(tmp_path.iterdir()) == [file]


def test_checkpoints_of_another_training(scene, tmp_path):
    file = tmp_path / "model.npz"
    fit(scene, TINY, steps=2, checkpoint=file)
    options = {"steps": 4, "checkpoint": file, "resume": True}
    for rule, changed in (
        ("field", {"field": replace(TINY, table_bits=11)}),
        ("background", {"background": "white"}),
        ("seed", {"seed": 3}),
        ("scene", {"scene": replace(scene, near=1.0)}),
    ):
        given = {"scene": scene, "field": TINY, **options, **changed}
        with pytest.raises(ValueError, match=f"checkpoint must be of the same {rule}"):
            fit(**given)
    assert load_model(file).training.step == 2
    fresh = fit(scene, TINY, steps=3, checkpoint=tmp_path / "new.npz", resume=True)
    assert fresh.training.step == 3


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
        ({"field": "hash"}, TypeError, r"field must be settings such as HashField\(\), got 'hash'"),
        ({"checkpoint": "model.npy"}, ValueError, "path must end in .npz, got 'model.npy'"),
        ({"checkpoint": "none/m.npz"}, FileNotFoundError, "path must lie in a folder that exists"),
        ({"resume": True}, ValueError, "checkpoint must be given to resume from, got None"),
    ],
)
def test_errors_of_fit(scene, options, error, rule):
    with pytest.raises(error, match=rule):
        fit(scene, **options)


def test_scenes_that_cannot_be_trained_from(scene):
    with pytest.raises(ValueError, match="scene must have views to train from, got 18 kept back"):
        fit(replace(scene, test=np.ones(len(scene), bool)), steps=1)
    with pytest.raises(TypeError, match="scene must be a Scene, got str"):
        fit("scene", steps=1)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="scene must have images of uint8, got float32"):
        fit(replace(scene, images=np.full((18, 24, 24, 3), np.nan, np.float32)), steps=1)
    for shape in ((17, 24, 24, 3), (18, 24, 23, 3), (18, 24, 24, 2), (18, 24, 24)):
        with pytest.raises(ValueError, match=r"scene must have RGB or RGBA images of 24 x 24"):
            fit(replace(scene, images=np.zeros(shape, np.uint8)), steps=1)
    model = fit(scene, TINY, steps=1)
    with pytest.raises(ValueError, match="scene must have views kept back"):
        evaluate(model, replace(scene, test=np.zeros(len(scene), bool)))
    with pytest.raises(ValueError, match=r"views must be in \[0, 17\], got 99"):
        evaluate(model, scene, views=[99])


@pytest.mark.parametrize("name", ["fit", "make_scene"])
def test_what_is_not_kernels_alone_is_refused(scene, name):
    calls = {"fit": lambda image: fit(scene, TINY, steps=1), "make_scene": lambda _: make_scene()}
    with pytest.raises(ValueError, match=f"captured functions must be kernels alone, got {name}"):
        cvkern.capture(calls[name], np.zeros((4, 4), np.float32))
