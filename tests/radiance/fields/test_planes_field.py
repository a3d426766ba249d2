"""Fields of planes: where they are, what they learn, their files, and what they refuse."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import cvkern
from cvkern.radiance import (
    PlanesField,
    VoxelField,
    cameras,
    evaluate,
    fit,
    load_model,
    make_scene,
    render,
)
from cvkern.radiance.fields.planes import PlaneStack
from tests.radiance.runs import interrupt, press_ctrl_c, same

SMALL = PlanesField(planes=12, rays=1024)
START, LEARNT = 26.4, 30.0  # measured on held-out views before and after 100 steps, dB


@pytest.fixture(scope="module")
def scene():
    return make_scene(train=12, test=2, size=48, layout="forward")


@pytest.fixture(scope="module")
def model(scene):
    return fit(scene, SMALL, steps=100, progress=False)


def stack(model):
    assert isinstance(model.field, PlaneStack)
    return model.field


def test_planes_learn_what_a_sweep_begins(scene, model):
    start = fit(scene, SMALL, steps=1, progress=False)
    assert evaluate(start, scene).psnr.mean() > START - 1
    assert evaluate(model, scene).psnr.mean() > LEARNT - 1
    # The planes are where the surfaces are: these begin at 2 and end at 6.3, along the rays.
    depths = model.frame.bounds.half / stack(model).reference.disparities
    assert 1.7 < depths[0] < 3.0
    assert 4.5 < depths[-1] < 9.0
    view = int(np.flatnonzero(scene.test)[0])
    off = np.abs(render(model, scene.cameras, view).depth / scene.depths[view] - 1)
    assert np.nanmedian(off) < 0.09  # planes are up to 10 % of the depth apart


def test_training_is_the_same_from_run_to_run_and_with_any_number_of_threads(scene, monkeypatch):
    states = []
    for threads in ("1", "2", "4"):
        monkeypatch.setenv("CVKERN_NUM_THREADS", threads)
        with cvkern.use(backend="warp", device="cpu"):
            states.append(fit(scene, SMALL, steps=20, progress=False).field.state())
    for state in states[1:]:
        for name, values in states[0].items():
            assert np.array_equal(state[name], values), name


def test_kernel_sets_agree(scene):
    seen = []
    for backend in ("warp", "taichi"):
        with cvkern.use(backend=backend, device="cpu"):
            found = fit(scene, SMALL, steps=5, progress=False)
            seen.append(render(found, scene.cameras, 3).color)
    # A step of Adam moves a parameter by up to 0.1, also where a gradient is nearly 0.
    assert np.abs(seen[0] - seen[1]).mean() < 1e-3


def test_a_stopped_training_goes_on(scene, tmp_path, monkeypatch):
    file = tmp_path / "model.npz"
    straight = fit(scene, SMALL, steps=40, progress=False)
    with monkeypatch.context() as patch:
        interrupt(patch, 21, press_ctrl_c)
        stopped = fit(scene, SMALL, steps=40, checkpoint=file, progress=False)
    assert stopped.training.step == 21
    assert same(load_model(file), stopped)
    on = fit(scene, "planes", steps=40, checkpoint=file, resume=True, progress=False)
    assert same(on, straight)


def test_files(scene, model, tmp_path):
    whole, small = tmp_path / "whole.npz", tmp_path / "small.npz"
    model.save(whole)
    model.save(small, resumable=False)
    assert small.stat().st_size < 0.1 * whole.stat().st_size
    seen = render(model, scene.cameras, 2)
    np.testing.assert_array_equal(render(load_model(whole), scene.cameras, 2).color, seen.color)
    rounded = render(load_model(small), scene.cameras, 2)
    assert np.abs(rounded.color - seen.color).max() < 0.05
    assert np.abs(rounded.color - seen.color).mean() < 0.005
    with pytest.raises(ValueError, match="checkpoint must be resumable"):
        fit(scene, "planes", steps=120, checkpoint=small, resume=True)
    bytes_ = whole.read_bytes()
    for end in (100, len(bytes_) // 2, len(bytes_) - 10):
        (tmp_path / "cut.npz").write_bytes(bytes_[:end])
        with pytest.raises(ValueError, match=r"cut\.npz"):
            load_model(tmp_path / "cut.npz")


def test_colours_that_depend_on_the_side(tmp_path, monkeypatch):
    """A wall whose brightness follows the camera's place, as no colours of texels can."""
    wall = make_scene(train=12, test=2, size=32, layout="forward")
    aside = wall.cameras.poses[:, :, 3] @ wall.cameras.poses[:, :, 0].mean(axis=0)
    gain = 1 + 0.3 * (aside - aside.mean()) / np.abs(aside - aside.mean()).max()
    images = wall.images.copy()
    shown = images[..., :3] * gain[:, None, None, None]
    images[..., :3] = np.round(shown).clip(0, 255)
    lit = replace(wall, images=images)
    plain = PlanesField(planes=8, rays=1024)
    shiny, options = replace(plain, basis=2, shared=4), {"steps": 60, "progress": False}
    seen = [evaluate(fit(lit, field, **options), lit).psnr.mean() for field in (plain, shiny)]
    assert seen[1] > seen[0] + 0.5
    file = tmp_path / "model.npz"
    straight = fit(lit, shiny, **options)
    with monkeypatch.context() as patch:
        interrupt(patch, 21, press_ctrl_c)
        fit(lit, shiny, checkpoint=file, **options)
    on = fit(lit, "planes", checkpoint=file, resume=True, **options)
    assert same(on, straight)
    on.save(file, resumable=False)
    small = load_model(file)
    assert np.abs(small.field.state()["shine.values"]).max() > 0.01
    found, want = (render(m, lit.cameras, 1).color for m in (small, on))
    assert np.abs(found - want).mean() < 0.01
    with pytest.raises(ValueError, match="basis must be 0, 2 or 5, got 3"):
        PlanesField(basis=3)


def test_cameras_anywhere(scene, model):
    """Beyond the planes, looking back, or aside, nothing is seen; in between, what is left."""
    pose = scene.cameras.poses[0]
    axis, lens = pose[:, 2], scene.cameras.intrinsics[0]
    back = pose @ np.diag([1, -1, -1, 1])  # half a turn about x

    def opacity(pose):
        return render(model, cameras(pose[None], lens, 48, 48)).opacity

    assert opacity(pose).mean() > 0.9
    assert not opacity(back).any()
    beyond = pose.copy()
    beyond[:, 3] += 30 * axis
    assert not opacity(beyond).any()
    between = pose.copy()
    between[:, 3] += 3.5 * axis
    assert opacity(between).mean() > 0.1
    aside = pose.copy()
    aside[:, 3] += 40 * pose[:, 0]
    assert not opacity(aside).any()


def test_one_plane(scene):
    found = fit(scene, PlanesField(planes=1, rays=512), steps=30, progress=False)
    assert stack(found).texels.shape[0] == 1
    assert evaluate(found, scene).psnr.mean() > 15  # an average of all depths
    assert found.field.densities(np.zeros((2, 3))).shape == (2,)


def test_given_depths_and_detail(scene):
    field = PlanesField(planes=4, near=2.0, far=8.0, detail=0.5, rays=64)
    found = stack(fit(scene, field, steps=1, progress=False))
    depths = found.frame.bounds.half / found.reference.disparities
    np.testing.assert_allclose(depths[[0, -1]], [2, 8], rtol=1e-6)
    fine = stack(fit(scene, replace(field, detail=1.0), steps=1, progress=False))
    assert fine.texels.shape[1] == pytest.approx(2 * found.texels.shape[1], abs=2)
    few = stack(fit(scene, replace(field, texels=2000), steps=1, progress=False))
    assert 1000 < np.prod(few.texels.shape[:3]) <= 2000


def test_density_is_that_of_opaque_planes(model):
    field = stack(model)
    pose, _, disparities = field.reference
    ahead = pose[:, 3] + np.linspace(0.5, 1.2, 60)[:, None] / disparities[-1] * pose[:, 2]
    found = field.densities(ahead)
    assert found.max() > 1
    assert found[-1] == 0  # beyond the last plane
    assert not field.densities(pose[None, :, 3] - pose[:, 2]).any()  # behind the camera


def test_refusals(scene):
    around = make_scene(train=6, test=0, size=24)
    with pytest.raises(ValueError, match="scene must be photographed from one side for planes"):
        fit(around, "planes", steps=1)
    mistakes: Any = (
        (r"planes must be in \[1, 512\], got 0", {"planes": 0}),
        ("near must be below far, got 3 and 2", {"near": 3.0, "far": 2.0}),
        ("near must be > 0", {"near": 0.0}),
        (r"texels must be in \[128, ", {"texels": 8}),
    )
    for message, given in mistakes:
        with pytest.raises(ValueError, match=message):
            PlanesField(**given)
    with pytest.raises(ValueError, match="near must be below far, got 90 and 9"):
        fit(scene, PlanesField(near=90.0, planes=2), steps=1)


def test_other_fields_learn_scenes_from_one_side(scene):
    grid = VoxelField(resolutions=(16, 32), shares=(0.3,), rays=256)
    assert fit(scene, grid, steps=20, progress=False).training.step == 20
