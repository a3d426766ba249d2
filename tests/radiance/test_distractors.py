"""What passes in front of a scene: weights of rays against NumPy, masks, and robust training."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import convolve

from cvkern._runtime import runtime
from cvkern.images import write_image
from cvkern.kernels.codes.radiance import Patches
from cvkern.radiance import evaluate, fit, load_model, load_scene, make_scene, render
from cvkern.radiance.rendering import owned, photograph
from cvkern.radiance.wild.distractors import patches_of
from profiling.experiments.wild_quality import changed
from tests.radiance.runs import GRID, interrupt, press_ctrl_c, same

RAYS, ACTIVE, SHAPE, SIDE = 60, 50, (3, 4, 5), 2  # rays, and patches of photographs of 7 x 9
F32, I32 = np.float32, np.int32


@pytest.mark.usefixtures("backend")
def test_weights_are_probabilities():
    rt, rng = runtime(), np.random.default_rng(0)
    errors, views = rng.exponential(0.02, RAYS), rng.integers(0, 3, RAYS)
    row, column = rng.integers(0, 7, RAYS), rng.integers(0, 9, RAYS)
    share, noise = rng.uniform(0.05, 0.999, SHAPE), 0.01
    gradients = [rng.normal(size=s) for s in ((RAYS, 3), RAYS, (RAYS, 3))]
    sums, counts = (owned(rt, rng.integers(0, 9, SHAPE).astype(I32)) for _ in "ab")
    before = [rt.to_numpy(a).copy() for a in (sums, counts)]
    patches = Patches(
        owned(rt, share.astype(F32)), sums, counts, owned(rt, np.array([noise], F32)), 9, SIDE
    )
    given = [owned(rt, g.astype(F32)) for g in gradients]
    moments = rt.zeros((RAYS, 3))
    first, second, active = (
        owned(rt, a.astype(I32)) for a in (views, 9 * row + column, np.array([ACTIVE]))
    )
    kernels = rt.radiance.wild.distractors
    a, b, c = given
    kernels.weigh(owned(rt, errors.astype(F32)), first, second, active, patches, a, b, c, moments)
    # Bayes' rule with normal densities of three channels, and the density 1 of any colour.
    p = share[views, row // SIDE, column // SIDE]
    scene = p * (2 * np.pi * noise) ** -1.5 * np.exp(-3 * errors / (2 * noise))
    weight = scene / (scene + 1 - p)
    assert (weight < 0.1).any()
    assert (weight > 0.9).any()
    for found, gradient in zip(given, gradients, strict=True):
        scale = np.where(np.arange(RAYS) < ACTIVE, weight, 1)
        scale = scale if gradient.ndim == 1 else scale[:, None]
        np.testing.assert_allclose(rt.to_numpy(found), scale * gradient, rtol=1e-4, atol=1e-6)
    found = rt.to_numpy(moments)[:ACTIVE]
    wanted = np.stack((weight * errors, weight, 0 * weight), 1)[:ACTIVE]
    np.testing.assert_allclose(found, wanted, rtol=1e-4, atol=1e-6)
    at = views[:ACTIVE], row[:ACTIVE] // SIDE, column[:ACTIVE] // SIDE
    for array, sums_, add in zip(
        (sums, counts), before, (np.floor(256 * found[:, 1] + 0.5), 1), strict=True
    ):
        np.add.at(sums_, at, add)
        np.testing.assert_array_equal(rt.to_numpy(array), sums_)
    totals = owned(rt, np.array([0.6, 20, 0], F32))
    kernels.learn_noise(totals, 0.5, 0.001, patches.noise)
    assert rt.to_numpy(patches.noise)[0] == pytest.approx(0.5 * noise + 0.5 * 0.03)
    assert not rt.to_numpy(totals).any()
    kernels.learn_noise(totals, 0.5, 0.001, patches.noise)  # no ray: nothing is learnt
    assert rt.to_numpy(patches.noise)[0] == pytest.approx(0.02)


@pytest.mark.usefixtures("backend")
def test_patches_are_averaged_with_their_neighbours():
    rt, rng = runtime(), np.random.default_rng(1)
    counts = rng.integers(0, 20, SHAPE)
    sums = (256 * counts * rng.random(SHAPE)).astype(int)
    arrays = [owned(rt, a.astype(I32)) for a in (sums, counts)]
    patches = Patches(rt.zeros(SHAPE), arrays[0], arrays[1], rt.zeros((1,)), 9, SIDE)
    rt.radiance.wild.distractors.settle(patches, 0.99, 4.0, 10)
    around = np.ones((1, 3, 3), int)
    total, count = (convolve(a, around, mode="constant") for a in (sums, counts))
    share = ((total / 256 + 4 * 0.99) / (count + 4)).clip(0.01, 0.99)
    np.testing.assert_allclose(rt.to_numpy(patches.share), share, rtol=1e-6)
    for array, values in zip(arrays, (sums, counts), strict=True):
        wanted = np.where(counts > 10, values // 2, values)
        np.testing.assert_array_equal(rt.to_numpy(array), wanted)


@pytest.fixture(scope="module")
def clean():
    return make_scene(train=20, test=3, size=32)


def test_occluders_are_ignored_and_a_clean_scene_loses_little(clean, tmp_path):
    wild, options = changed(clean, "occluder"), {"steps": 400, "progress": False}
    plain, robust = (fit(wild, GRID, robust=r, **options) for r in (False, True))
    found = evaluate(robust, wild).psnr.mean()
    assert found > evaluate(plain, wild).psnr.mean() + 2  # measured: 24.3 and 20.8 dB
    hidden = (wild.images != clean.images).any(axis=3)
    assert robust.weights[hidden].mean() < 0.85
    assert robust.weights[~hidden].mean() > 0.96
    assert (robust.weights[clean.test] == 1).all()
    robust.save(tmp_path / "model.npz")
    read = load_model(tmp_path / "model.npz")
    assert read.robust
    np.testing.assert_array_equal(read.weights, robust.weights)
    same_scene = [evaluate(fit(clean, GRID, robust=r, **options), clean) for r in (False, True)]
    assert same_scene[1].psnr.mean() > same_scene[0].psnr.mean() - 0.3


def test_runs_are_equal_and_go_on(clean, tmp_path, monkeypatch):
    file, wild = tmp_path / "model.npz", changed(clean, "both")
    options = {"steps": 40, "progress": False, "appearance": "affine"}
    straight = fit(wild, GRID, robust=True, **options)
    with monkeypatch.context() as patch:
        interrupt(patch, 21, press_ctrl_c)
        fit(wild, GRID, robust=True, checkpoint=file, **options)
    on = fit(wild, GRID, checkpoint=file, resume=True, **options)
    assert same(on, straight)
    np.testing.assert_array_equal(on.weights, straight.weights)
    plain = tmp_path / "plain.npz"
    fit(wild, GRID, checkpoint=plain, **options)
    with pytest.raises(ValueError, match="checkpoint must be of the same robust, got False"):
        fit(wild, GRID, robust=True, checkpoint=plain, resume=True, **options)


def test_masks_of_scenes(clean, tmp_path):
    masks = np.random.default_rng(2).random(clean.images.shape[:3]) < 0.7
    scene = replace(clean, masks=masks)
    small = scene.resized(2)
    assert small.masks is not None
    blocks = masks.reshape(len(scene), 16, 2, 16, 2)
    np.testing.assert_array_equal(small.masks, blocks.all(axis=(2, 4)))
    model = fit(scene, GRID, steps=20, progress=False)
    other = clean.images.copy()
    other[~masks] = 99  # nobody looks there
    assert same(fit(replace(scene, images=other), GRID, steps=20, progress=False), model)
    view = int(np.flatnonzero(clean.test)[0])
    score = evaluate(model, scene, views=[view]).psnr[0]
    error = render(model, scene.cameras, view).color - photograph(scene, view, model.behind)
    assert score == pytest.approx(-10 * np.log10((error[masks[view]] ** 2).mean()), abs=1e-4)
    empty = masks.copy()
    empty[view] = False
    assert np.isnan(evaluate(model, replace(clean, masks=empty), views=[view]).psnr[0])
    with pytest.raises(ValueError, match="scene must have pixels to train from"):
        fit(replace(clean, masks=np.zeros_like(masks)), GRID, steps=1)
    with pytest.raises(TypeError, match="masks must be bool"):
        replace(clean, masks=masks.astype(np.uint8))
    with pytest.raises(ValueError, match=r"masks must have shape \(23, 32, 32\)"):
        replace(clean, masks=masks[1:])


def test_masks_of_files(tmp_path):
    images = np.zeros((2, 6, 8, 3), np.uint8)
    mask = np.zeros((6, 8), np.uint8)
    mask[1:4] = 200
    frames = []
    for i, image in enumerate(images):
        write_image(tmp_path / f"v{i}.png", image)
        frames.append({"file_path": f"v{i}.png", "transform_matrix": np.eye(4).tolist()})
    frames[1]["mask_path"] = "masks/v1.png"
    (tmp_path / "masks").mkdir()
    write_image(tmp_path / "masks" / "v1.png", mask)
    file = tmp_path / "transforms.json"
    file.write_text(json.dumps({"fl_x": 8, "aabb_scale": 4, "frames": frames}))
    found = load_scene(tmp_path, test_every=0).masks
    assert found is not None
    np.testing.assert_array_equal(found, [np.ones((6, 8)), mask > 0])
    write_image(tmp_path / "masks" / "v1.png", mask[:5])
    with pytest.raises(ValueError, match=r"v1\.png must have the size of its photograph"):
        load_scene(tmp_path)
    frames[1]["mask_path"] = "../elsewhere.png"
    file.write_text(json.dumps({"fl_x": 8, "aabb_scale": 4, "frames": frames}))
    with pytest.raises(ValueError, match="must name photographs in its folder"):
        load_scene(tmp_path)
    (tmp_path / "transforms.json").unlink()
    # LLFF and COLMAP: a folder beside that of the photographs
    (tmp_path / "masks" / "v1.png").unlink()
    (tmp_path / "images").mkdir()
    for i, image in enumerate(images):
        write_image(tmp_path / "images" / f"v{i}.png", image)
    write_image(tmp_path / "masks" / "v0.png.png", mask)
    row = np.column_stack((np.eye(3)[:, [1, 0, 2]] * [1, 1, -1], [0, 0, 0], [6, 8, 8])).ravel()
    table = np.stack([np.append(row, [1, 9])] * 2)
    table[1, 3] = 0.5
    np.save(tmp_path / "poses_bounds.npy", table)
    found = load_scene(tmp_path).masks
    np.testing.assert_array_equal(found, [mask > 0, np.ones((6, 8))])
    assert patches_of(6, 8) == (4, 2, 2)
