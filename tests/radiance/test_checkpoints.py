"""Models as files: saved whole or not at all, resumed, damaged."""

import errno
import os
import signal
import zipfile
from dataclasses import replace

import numpy as np
import pytest

import cvkern
from cvkern.radiance import (
    VoxelField,
    checkpoints,
    evaluate,
    fit,
    load_model,
    make_scene,
    models,
    psnr,
    render,
)
from cvkern.radiance.trainer import Trainer
from tests.radiance.runs import FIELDS, GRID, TINY, interrupt, press_ctrl_c, same


@pytest.fixture(scope="module")
def scene():
    return make_scene(train=16, test=2, size=24)


@pytest.mark.parametrize(
    ("backend", "step", "field"),
    [("warp", step, field) for step in (21, 32) for field in (TINY, GRID)] + [("taichi", 21, GRID)],
    ids=["warp-21-hash", "warp-21-voxel", "warp-32-hash", "warp-32-voxel", "taichi-21-voxel"],
    indirect=["backend"],
)
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


@FIELDS
def test_a_larger_budget_is_what_counts(scene, tmp_path, field):
    """Trainings of any length are the same up to the first look of the host at the clock."""
    file = tmp_path / "model.npz"
    fit(scene, field, steps=16, checkpoint=file)
    on = fit(scene, field, steps=48, checkpoint=file, resume=True)
    assert same(on, fit(scene, field, steps=48))


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
    assert small < 0.25 * whole
    read = load_model(tmp_path / "small.npz")
    seen, want = (render(m, scene.cameras, 3) for m in (read, model))
    assert psnr(seen.color, want.color) > 55  # half precision has steps of 1 / 2048
    lost = evaluate(model, scene).psnr - evaluate(read, scene).psnr
    assert np.abs(lost).max() < 0.02
    read.save(tmp_path / "again.npz")
    for name in ("small.npz", "again.npz"):
        with pytest.raises(ValueError, match="checkpoint must be resumable, got"):
            fit(scene, field, steps=30, checkpoint=tmp_path / name, resume=True)


@pytest.mark.parametrize("field", ["hash", None])
def test_going_on_takes_the_settings_of_the_file(scene, tmp_path, field):
    options = {"checkpoint": tmp_path / "model.npz", "resume": True}
    fit(scene, TINY, steps=2, **options)
    on = fit(scene, field, steps=4, **options)
    assert (on.settings, on.training.step) == (TINY, 4)


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


def test_headers_damaged(model, tmp_path):
    """NumPy reads the header of an array as Python's tokens, of which the last is missing."""
    file = tmp_path / "model.npz"
    model.save(file)
    file.write_bytes(file.read_bytes().replace(b"), }", b"), (", 1))
    with pytest.raises(ValueError, match="path must be a whole model"):
        load_model(file)


@pytest.mark.parametrize(("at", "value"), [(8, 1), (10, 99)], ids=["encrypted", "packed"])
def test_directories_damaged(model, tmp_path, at, value):
    """A bit of the archive's directory says what we never write."""
    file = tmp_path / "model.npz"
    model.save(file)
    whole = bytearray(file.read_bytes())
    whole[whole.rindex(b"PK\1\2") + at] = value
    file.write_bytes(whole)
    with pytest.raises(ValueError, match="path must be a whole model"):
        load_model(file)


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
        ('"version": 3', '"version": 2', "of version 3, got 'cvkern radiance field' of version 2"),
        ("cvkern radiance field", "something else", "got 'something else'"),
        ('"HashField"', '"NoField"', "field must be one of"),
        ('"table_bits": 12', '"table_bits": 11', "table.values must have shape"),
        ('"cells": 32', '"cells": 64', "occupancy.density must have shape"),
        ('"levels"', '"stories"', "stories"),
        ('"near"', '"far_off"', "no 'near'"),
        ('"half": 1', '"half": -1', "half must be > 0"),
        ('"background": "learnt"', '"background": "blue"', "background must be one of"),
        (f'"rays": {model.training.rays}, "total', '"rays": 513, "total', "rays must be in"),
    ):
        header = edited(source, old, new)
        with pytest.raises(ValueError, match=rule):
            load_model(rewritten(source, target, header=header))
    for name, rule in (("state.layers.mean", "state must have 'layers.mean'"), ("header", "header"),
                       ("behind", "must have 'behind'")):  # fmt: skip
        with pytest.raises(ValueError, match=rule):
            load_model(rewritten(source, target, **{name: None}))
    with pytest.raises(ValueError, match=r"layers\.mean must have shape"):
        load_model(rewritten(source, target, **{"state.layers.mean": np.zeros(3, np.float32)}))
    with pytest.raises(ValueError, match=r"behind must be float32, got float64"):
        load_model(rewritten(source, target, behind=np.zeros(3)))
    for marks in (np.zeros(5), np.zeros((2, 4)), np.full((1, 5), np.inf)):
        with pytest.raises(ValueError, match="path must be a whole model"):
            load_model(rewritten(source, target, marks=marks))
    with pytest.raises(ValueError, match="path must be a whole model"):  # a pickled object
        load_model(rewritten(source, target, behind=np.array([None, {}], object)))


@pytest.mark.parametrize(
    ("field", "old", "new", "rule"),
    [
        (GRID, '"resolutions": [16, 32]', '"resolutions": [384, 400]', "density must have a shape"),
        (TINY, '"table_bits": 12', '"table_bits": 24', "table.values must have shape"),
        (TINY, '"cells": 32', '"cells": 512', "occupancy.density must have shape"),
        (TINY, '"near": ', '"near": -', "near, far and pixel must be in range"),
        (TINY, '"pixel": ', '"pixel": NaN, "x": ', "near, far and pixel must be in range"),
    ],
)
def test_nothing_is_allocated_for_a_header_that_does_not_fit(
    scene, tmp_path, monkeypatch, field, old, new, rule
):
    source, target = tmp_path / "model.npz", tmp_path / "other.npz"
    fit(scene, field, steps=1).save(source)
    rewritten(source, target, header=edited(source, old, new))
    monkeypatch.setattr(models, "built", None)
    with pytest.raises(ValueError, match=rule):
        load_model(target)


def test_settings_that_ask_for_too_much_memory(scene, tmp_path, monkeypatch):
    def too_large(*_):
        raise MemoryError("Unable to allocate 30 GiB")

    fit(scene, GRID, steps=1).save(tmp_path / "model.npz")
    monkeypatch.setattr(models, "built", too_large)
    with pytest.raises(ValueError, match="its settings must fit into memory, got VoxelField"):
        load_model(tmp_path / "model.npz")


def test_files_of_other_kinds(tmp_path):
    file = tmp_path / "model.npz"
    with pytest.raises(FileNotFoundError, match="path must be a file that exists"):
        load_model(file)
    np.savez(file, a=np.zeros(3))
    with pytest.raises(ValueError, match="path must be a whole model"):
        load_model(file)
    file.write_text("words")
    with pytest.raises(ValueError, match="path must be a model of cvkern"):
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


def test_what_cannot_be_written_to_is_refused_before_the_training(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(Trainer, "step", lambda self: pytest.fail("trained in vain"))
    (tmp_path / "folder.npz").mkdir()
    with pytest.raises(ValueError, match=r"path must name a regular file, got .*folder\.npz"):
        fit(scene, TINY, steps=2, checkpoint=tmp_path / "folder.npz")
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with pytest.raises(PermissionError, match="path must lie in a folder to write to"):
        fit(scene, TINY, steps=2, checkpoint=tmp_path / "model.npz")


def test_settings_of_numpy_can_be_saved(scene, tmp_path):
    field = replace(TINY, rays=np.int64(64), learning_rate=np.float32(0.01))
    fit(scene, field, steps=2, checkpoint=tmp_path / "model.npz")
    assert load_model(tmp_path / "model.npz").settings == field


def test_checkpoints_of_another_training(scene, tmp_path):
    file = tmp_path / "model.npz"
    fit(scene, TINY, steps=2, checkpoint=file)
    options = {"steps": 4, "checkpoint": file, "resume": True}
    for rule, changed in (
        (
            "field, got table_bits 12 instead of table_bits 11$",
            {"field": replace(TINY, table_bits=11)},
        ),
        ("field, got HashField instead of VoxelField$", {"field": VoxelField()}),
        ("field, got HashField instead of mlp$", {"field": "mlp"}),
        ("background, got random instead of white$", {"background": "white"}),
        ("seed, got 0 instead of 3$", {"seed": 3}),
        (r"scene, got near 2\.\d* instead of near 0\.9\d*$", {"scene": replace(scene, near=1.0)}),
    ):
        given = {"scene": scene, "field": TINY, **options, **changed}
        with pytest.raises(ValueError, match=f"checkpoint must be of the same {rule}"):
            fit(**given)
    assert load_model(file).training.step == 2
    fresh = fit(scene, TINY, steps=3, checkpoint=tmp_path / "new.npz", resume=True)
    assert fresh.training.step == 3


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("state.table.values", "table.values must have shape"),
        ("state.occupancy.bits", "occupancy.bits must have shape"),
        ("cameras.poses", "cameras.poses must have shape"),
        ("behind", "behind must have shape"),
        ("marks", "marks must have shape"),
        ("extra.more", "more must have shape"),
    ],
)
def test_shapes_are_those_of_the_settings_before_anything_is_read(
    model, tmp_path, monkeypatch, name, said
):
    """Zeros are packed a thousand times smaller: a small file would take any memory."""
    source, target, asked = tmp_path / "model.npz", tmp_path / "other.npz", []
    model.save(source)
    rewritten(source, target, **{name: np.zeros((64, 99))})
    take = checkpoints.Stored.__getitem__

    def noted(stored, key):
        asked.append(stored._group + key)
        return take(stored, key)

    monkeypatch.setattr(checkpoints.Stored, "__getitem__", noted)
    with pytest.raises(ValueError, match=said):
        load_model(target)
    assert name not in asked
    assert asked or name == "cameras.poses"
