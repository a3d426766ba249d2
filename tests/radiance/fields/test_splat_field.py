"""Fields of splats: what they learn, where they begin, their files, and what they refuse."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial import KDTree

import cvkern
from cvkern.clouds import write_ply
from cvkern.kernels.codes.splats import Splats
from cvkern.radiance import (
    SplatField,
    VoxelField,
    fit,
    load_model,
    load_splats,
    make_scene,
    mesh,
    pixel_rays,
    point_cloud,
    render,
    render_transient,
    write_splats,
)
from cvkern.radiance.fields.splats import SplatCloud
from cvkern.radiance.splats import starts
from tests.radiance.runs import interrupt, press_ctrl_c, same

SMALL = SplatField(splats=600, start="random")
STEPS = 120
LEARNT = 17.5  # measured: 18.4 dB on held-out views


@pytest.fixture(scope="module")
def scene():
    return make_scene(train=10, test=2, size=32)


@pytest.fixture(scope="module")
def model(scene):
    return fit(scene, SMALL, steps=STEPS, progress=False)


def cloud(model):
    assert isinstance(model.field, SplatCloud)
    return model.field


def test_it_learns(model):
    mark = model.training.marks[-1]
    assert mark.test_psnr > LEARNT
    assert mark.psnr > LEARNT


def test_the_same_steps_give_the_same_model(scene, model, monkeypatch):
    again = fit(scene, SMALL, steps=STEPS, progress=False, deterministic=True)
    assert same(model, again)
    other = fit(scene, SMALL, steps=STEPS, progress=False, seed=1)
    assert not same(model, other)


def test_both_sets_learn_alike(scene):
    """Their exponentials and logarithms differ in Adam alone, by a few units in the last place."""
    found = []
    for backend in ("warp", "taichi"):
        with cvkern.use(backend=backend):
            trained = fit(scene, SMALL, steps=8, progress=False)
            found.append(render(trained, scene.cameras).color)
    np.testing.assert_allclose(*found, atol=0.01)


def test_a_resumed_training_is_the_same(scene, model, tmp_path, monkeypatch):
    file = tmp_path / "model.npz"
    with monkeypatch.context() as patch:
        interrupt(patch, 50, press_ctrl_c)
        part = fit(scene, SMALL, steps=STEPS, checkpoint=file, progress=False)
    assert part.training.stopped
    on = fit(scene, "splats", steps=STEPS, checkpoint=file, resume=True, progress=False)
    assert on.training.step == STEPS
    for name, values in on.field.state().items():  # rates follow the budget every 16 steps
        np.testing.assert_array_equal(values, model.field.state()[name], err_msg=name)
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match=r"model\.npz"):
        load_model(file)


def test_files_to_render(scene, model, tmp_path):
    full, small = tmp_path / "full.npz", tmp_path / "small.npz"
    model.save(full)
    model.save(small, resumable=False)
    assert small.stat().st_size < full.stat().st_size / 4
    picture = render(model, scene.cameras, 1)
    np.testing.assert_array_equal(render(load_model(full), scene.cameras, 1).color, picture.color)
    # Colours and sizes have 11 bits in half precision.
    kept = render(load_model(small), scene.cameras, 1)
    np.testing.assert_allclose(kept.color, picture.color, atol=0.02)
    with pytest.raises(ValueError, match="checkpoint must be resumable"):
        fit(scene, "splats", steps=9, checkpoint=small, resume=True)


@pytest.mark.parametrize("degree", [0, 2, 3])
def test_ply_files(scene, degree, tmp_path):
    model = fit(scene, replace(SMALL, degree=degree), steps=20, progress=False)
    write_splats(tmp_path / "splats.ply", model)
    found = load_splats(tmp_path / "splats.ply", scene.cameras)
    assert (found.settings.splats, found.settings.degree) == (SMALL.splats, degree)
    assert found.settings.blur == model.settings.blur
    one, other = (
        render(m, scene.cameras, 2, background=(0, 0, 0)) for m in (model, found)
    )  # fmt: skip
    np.testing.assert_allclose(one.color, other.color, atol=1e-4)
    np.testing.assert_allclose(one.depth, other.depth, rtol=1e-4)
    alone = load_splats(tmp_path / "splats.ply")
    assert render(alone, alone.cameras).opacity.mean() > 0.05
    write_splats(tmp_path / "again.ply", alone)
    again = load_splats(tmp_path / "again.ply", scene.cameras)
    for a, b in zip(cloud(found).splats, cloud(again).splats, strict=True):
        np.testing.assert_allclose(found.rt.to_numpy(a), found.rt.to_numpy(b), atol=1e-5)


def test_a_ply_file_is_that_of_3dgs(tmp_path):
    """Another program's reading: a red splat, long in z, that is green from the side of +x."""
    names = ["x", "y", "z", "nx", "ny", "nz", *(f"f_dc_{k}" for k in range(3)),
             *(f"f_rest_{k}" for k in range(9)), "opacity", *(f"scale_{k}" for k in range(3)),
             *(f"rot_{k}" for k in range(4))]  # fmt: skip
    row = dict.fromkeys(names, 0.0)
    row |= {"opacity": 3.0, "scale_0": -3.0, "scale_1": -3.0, "scale_2": -1.5, "rot_0": 1.0}
    row |= {"f_dc_0": 0.5, "f_dc_1": -0.5, "f_dc_2": -1.7}
    row |= {"f_rest_2": 0.4, "f_rest_5": -0.4}  # x of red, then of green: -0.4886 x times these
    head = "".join(f"property float {name}\n" for name in names)
    text = " ".join(str(v) for v in row.values())
    file = tmp_path / "one.ply"
    file.write_text(f"ply\nformat ascii 1.0\nelement vertex 1\n{head}end_header\n{text}\n")
    views = cvkern.radiance.cameras(
        cvkern.radiance.look_at([[3, 0, 0], [-3, 0, 0]], [0, 0, 0]), [60, 60, 16, 16], 33, 33
    )
    model = load_splats(file, views)
    assert model.settings.blur == 0.3
    seen = [render(model, views, view) for view in (0, 1)]
    # The camera at +x sees along (-1, 0, 0): red has 0.5 + 0.28209 0.5 + 0.4886 0.4.
    opacity = 1 / (1 + np.exp(-3))
    for picture, sign in zip(seen, (1, -1), strict=True):
        red = 0.5 + 0.28209479 * 0.5 + sign * 0.48860251 * 0.4
        green = 1 - red
        np.testing.assert_allclose(picture.color[16, 16], opacity * np.array([red, green, 0.0205]),
                                   atol=2e-3)  # fmt: skip
        across = (picture.opacity > 0.1).sum(axis=1).max()
        assert (picture.opacity > 0.1).sum(axis=0).max() > 2 * across


def test_starts(scene, model, tmp_path):
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (50, 3))
    tints = np.full((50, 3), (255, 0, 0), np.uint8)
    file = str(tmp_path / "points.ply")
    write_ply(file, points, tints)
    found = cloud(fit(scene, replace(SMALL, start=file), steps=1, progress=False))
    splats = Splats(*(found.rt.to_numpy(a) for a in found.splats))
    half, center = scene.bounds.half, np.array(scene.bounds.center)
    world = splats.means * half + center
    # Each point is used twelve times, once just there; a step moves splats by their rate.
    apart = np.linalg.norm(world[:, None] - points, axis=2).min(axis=0)
    assert apart.max() < 0.02 * half
    assert splats.colors[:, 0].min() > 1.5
    write_splats(tmp_path / "splats.ply", model)
    again = replace(SMALL, splats=300, start=str(tmp_path / "splats.ply"))
    better = fit(scene, again, steps=40, progress=False).training.marks[-1].test_psnr
    plain = fit(scene, replace(again, start="random"), steps=40, progress=False)
    assert better > plain.training.marks[-1].test_psnr
    with pytest.raises(FileNotFoundError, match="path must be a file that exists"):
        fit(scene, replace(SMALL, start="nowhere.ply"), steps=1)


def begun(scene, start):
    """Return the places in the world and the colours of splats that have taken one step."""
    found = cloud(fit(scene, replace(SMALL, start=start), steps=1, progress=False))
    splats = Splats(*(found.rt.to_numpy(a) for a in found.splats))
    return splats.means * scene.bounds.half + scene.bounds.center, 0.5 + 0.282 * splats.colors


def shorten(monkeypatch):
    """Train a smaller field of voxels for fewer steps."""
    for name, value in (("CELLS", (32,)), ("SHARES", ()), ("STEPS", 60)):
        monkeypatch.setattr(starts, name, value)


def test_starts_from_points_of_colmap(scene, tmp_path):
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (50, 3))
    (tmp_path / "cameras.txt").write_text("1 PINHOLE 20 20 20 20 10 10\n")
    seen = " ".join(f"5 5 {n}" for n in range(50))
    (tmp_path / "images.txt").write_text(f"1 1 0 0 0 0 0 2 1 a.png\n{seen}\n")
    rows = (f"{n} {x} {y} {z} 0 255 0 0.5 1 {n}\n" for n, (x, y, z) in enumerate(points))
    (tmp_path / "points3D.txt").write_text("".join(rows))
    places, colors = begun(scene, str(tmp_path))
    apart = np.linalg.norm(places[:, None] - points, axis=2).min(axis=0)
    assert apart.max() < 0.02 * scene.bounds.half
    assert colors[:, 1].min() > 0.95
    assert colors[:, 0].max() < 0.05


def test_starts_from_a_short_training_of_voxels(scene, monkeypatch, tmp_path):
    """The scene's depths say where its surfaces are."""
    surface = np.concatenate([
        origins + depths[solid][:, None] * ways
        for view, depths in enumerate(scene.depths)
        for solid in [np.isfinite(depths)]
        for origins, ways in [pixel_rays(scene.cameras, view, np.argwhere(solid))]
    ])  # fmt: skip
    shorten(monkeypatch)
    gaps = {}
    for start in (None, "random"):
        places, _ = begun(scene, start)
        gaps[start], _ = KDTree(surface).query(places)
    assert np.median(gaps[None]) < 0.3 * np.median(gaps["random"])
    grid = VoxelField(resolutions=(16,), shares=(), rays=256)
    file = tmp_path / "grid.npz"
    fit(scene, grid, steps=60, checkpoint=file, progress=False)
    of_grid, _ = KDTree(surface).query(begun(scene, str(file))[0])
    assert np.median(of_grid) < 0.6 * np.median(gaps["random"])
    with monkeypatch.context() as patch:
        interrupt(patch, 5, press_ctrl_c)
        with pytest.raises(KeyboardInterrupt):
            begun(scene, None)


def test_pixels_under_masks_have_no_effect(scene):
    """Photographs that differ under masks alone make the same model."""
    masks = np.ones(scene.images.shape[:3], bool)
    masks[:, 8:20, 4:18] = False
    models = []
    for value in (0, 200):
        images = scene.images.copy()
        images[~masks] = value
        changed = replace(scene, images=images, masks=masks)
        models.append(fit(changed, SMALL, steps=30, progress=False))
    assert same(*models)
    assert models[0].training.marks[-1].psnr == models[1].training.marks[-1].psnr


def test_light_and_backgrounds(scene):
    for options in ({"appearance": "affine"}, {"background": "learnt"}, {"loss": "huber"}):
        given: Any = options
        found = fit(scene, SMALL, steps=30, progress=False, **given)
        assert np.isfinite(render(found, scene.cameras).color).all()
        assert found.training.marks[-1].psnr > 12
    with pytest.raises(ValueError, match="appearance must be 'affine'"):
        fit(scene, SMALL, steps=1, appearance="embedding")


def test_what_passes(monkeypatch):
    """Every second photograph has a bar that does not stay."""
    shorten(monkeypatch)
    scene = make_scene(train=10, test=0, size=32)
    images, hidden = scene.images.copy(), np.zeros(scene.images.shape[:3], bool)
    for k in range(1, 10, 2):
        hidden[k, 10:24, 3 + k : 8 + k] = True
    images[hidden] = 200, 30, 200, 255
    wild, field = replace(scene, images=images), replace(SMALL, start=None)
    weights = fit(wild, field, steps=150, progress=False, robust=True).weights
    # Measured: 0.64 and 0.95.
    assert np.nanmean(weights[hidden]) < np.nanmean(weights[~hidden]) - 0.15
    model = fit(wild, field, steps=300, progress=False, transient=True)
    taken = np.stack([render_transient(model, view).opacity for view in range(10)])
    assert taken[hidden].mean() > 2 * taken[~hidden].mean()  # measured: 0.21 and 0.06


def test_points_of_splats(scene, model):
    assert len(point_cloud(model).points) > 100


def test_refusals(scene, model, tmp_path):
    with pytest.raises(ValueError, match="spread must be 0 for splats, got 1"):
        fit(scene, SMALL, steps=1, spread=1.0)
    masked = replace(scene, masks=np.ones(scene.images.shape[:3], bool))
    for name in ("robust", "transient"):
        given: Any = {name: True}
        with pytest.raises(ValueError, match=f"{name} must not go with masks for splats"):
            fit(masked, SMALL, steps=1, **given)
    with pytest.raises(ValueError, match="model must have densities"):
        mesh(model)
    mistakes: Any = (
        (r"splats must be in \[1, ", {"splats": 0}),
        (r"degree must be in \[0, 3\], got 4", {"degree": 4}),
        ("fade must be >= 0", {"fade": -1.0}),
        ("learning_rate must be > 0", {"learning_rate": 0.0}),
        ("blur must be > 0", {"blur": 0.0}),
    )
    for message, options in mistakes:
        with pytest.raises(ValueError, match=message):
            SplatField(**options)
    with pytest.raises(TypeError, match="start must be a string or a path, got int"):
        SplatField(start=3)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match=r"path must end in \.ply"):
        write_splats(tmp_path / "splats.txt", model)
    grid = fit(scene, VoxelField(resolutions=(16,), shares=(), rays=64), steps=1, progress=False)
    with pytest.raises(ValueError, match="model must be of a SplatField, got VoxelField"):
        write_splats(tmp_path / "splats.ply", grid)


def test_broken_ply_files(model, tmp_path):
    file = tmp_path / "splats.ply"
    write_splats(file, model)
    whole = file.read_bytes()
    file.write_bytes(whole[:-5])
    with pytest.raises(ValueError, match="path must have 600 points as it says, got 599"):
        load_splats(file)
    file.write_bytes(whole.replace(b"float f_rest_44", b"float f_west_44"))
    with pytest.raises(ValueError, match="with 44"):
        load_splats(file)
    file.write_bytes(whole.replace(b"comment blur 0.", b"comment blur -0."))
    with pytest.raises(ValueError, match="path must have a blur > 0 in its comment"):
        load_splats(file)
    file.write_bytes(whole.replace(b"float opacity", b"float opacite"))
    with pytest.raises(ValueError, match="got one without opacity"):
        load_splats(file)
    file.write_bytes(whole[:-40] + np.array([np.nan], np.float32).tobytes() + whole[-36:])
    with pytest.raises(ValueError, match="path must have finite splats"):
        load_splats(file)
    write_ply(file, np.zeros((3, 3)))
    with pytest.raises(ValueError, match="got one without f_dc_0"):
        load_splats(file)
