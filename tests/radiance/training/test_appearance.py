"""Photographs of changing light: maps of colours and their gradients, against NumPy."""

from typing import Any

import numpy as np
import pytest
import scipy.optimize

from cvkern._runtime import runtime
from cvkern.kernels.codes.radiance import Background, Comparison
from cvkern.radiance import (
    HashField,
    PlanesField,
    evaluate,
    fit,
    fit_appearance,
    load_model,
    make_scene,
    psnr,
    render,
    render_path,
)
from cvkern.radiance.fields.hash import HashNetwork
from cvkern.radiance.rendering import owned, photograph
from profiling.experiments.wild_quality import changed
from tests.radiance.runs import GRID, interrupt, press_ctrl_c, same

RAYS, IMAGES, ACTIVE = 50, 4, 45
# Sums of some 12 products of numbers up to 3, in float32.
CLOSE = 1e-5


class Case:
    def __init__(self):
        rng = np.random.default_rng(0)
        self.color, self.opacity = rng.random((RAYS, 3)), rng.random(RAYS)
        self.table = 0.2 * rng.normal(size=(IMAGES, 12))
        self.views = rng.integers(0, IMAGES - 1, RAYS)  # the last one is not seen
        self.gradients = rng.normal(size=(RAYS, 3))

    def shown(self, color, opacity, table):
        maps = table.reshape(-1, 3, 4)[self.views]
        return (
            color + np.einsum("rij,rj->ri", maps[..., :3], color) + opacity[:, None] * maps[..., 3]
        )

    def loss(self, color, opacity, table):
        return (self.gradients * self.shown(color, opacity, table))[:ACTIVE].sum()


def on_device(rt, *arrays):
    return [owned(rt, a.astype(np.int32 if a.dtype.kind == "i" else np.float32)) for a in arrays]


@pytest.mark.usefixtures("backend")
def test_colours_are_mapped():
    rt, c = runtime(), Case()
    color, opacity, views, table = on_device(rt, c.color, c.opacity, c.views, c.table)
    rt.radiance.wild.appearance.apply(color, opacity, views, table, color)
    np.testing.assert_allclose(rt.to_numpy(color), c.shown(c.color, c.opacity, c.table), atol=CLOSE)


@pytest.mark.usefixtures("backend")
def test_gradients_are_central_differences():
    rt, c = runtime(), Case()
    color, opacity, views, table = on_device(rt, c.color, c.opacity, c.views, c.table)
    first = np.linspace(0, 1, RAYS)
    d_color, d_opacity, active = on_device(rt, c.gradients, first, np.array([ACTIVE]))
    d_table = owned(rt, np.full((IMAGES, 12), np.nan, np.float32))
    rt.radiance.wild.appearance.backward(
        color, opacity, views, table, active, d_color, d_opacity, rt.zeros((7, IMAGES, 12)), d_table
    )
    given = [c.color, c.opacity, c.table]
    found = [rt.to_numpy(d_color), rt.to_numpy(d_opacity) - first, rt.to_numpy(d_table)]
    for at, gradient in enumerate(found):
        wanted = np.zeros(gradient.shape)
        for index in np.ndindex(*gradient.shape):
            ends = []
            for step in (1e-4, -1e-4):
                moved = [a.copy() for a in given]
                moved[at][index] += step
                ends.append(c.loss(*moved))
            wanted[index] = (ends[0] - ends[1]) / 2e-4
        used = slice(None) if at == 2 else slice(ACTIVE)
        np.testing.assert_allclose(gradient[used], wanted[used], rtol=1e-4, atol=CLOSE)
    assert not found[2][-1].any()


@pytest.fixture(scope="module")
def scenes():
    clean = make_scene(train=16, test=2, size=24)
    return clean, changed(clean, "color")


@pytest.fixture(scope="module")
def model(scenes):
    return fit(scenes[1], GRID, steps=300, appearance="affine", progress=False)


def test_changed_light_is_told_from_the_scene(scenes, model):
    clean, wild = scenes
    plain = fit(wild, GRID, steps=300, progress=False)
    mapped, without = (evaluate(m, wild).psnr.mean() for m in (model, plain))
    assert mapped > without + 2  # measured: 25.2 and 21.2 dB
    # A photograph is as it was taken in its own light, and not in that of another.
    view = int(np.flatnonzero(~clean.test)[5])
    truth = photograph(wild, view, model.behind)
    own = render(model, wild.cameras, view, appearance=view)
    other = render(model, wild.cameras, view)
    assert psnr(own.color, truth) > psnr(other.color, truth) + 2
    np.testing.assert_array_equal(
        own.color, render(model, wild.cameras, view, appearance=model.appearances[view]).color
    )
    first = int(np.flatnonzero(~clean.test)[0])
    assert model.gauge == first
    np.testing.assert_array_equal(
        other.color, render(model, wild.cameras, view, appearance=first).color
    )


def test_the_light_of_the_gauge_is_found_again(scenes, model):
    """The map that fits its photograph best, by SciPy; channels that were clipped are bounds."""
    wild, view = scenes[1], model.gauge
    seen = render(model, wild.cameras, view, background=(0, 0, 0), appearance=np.eye(3, 4))
    found = np.column_stack((seen.color.reshape(-1, 3), seen.opacity.ravel())).astype(np.float64)
    image = wild.images[view].reshape(-1, 4)
    alpha = image[:, 3:] / 255
    wanted = image[:, :3] / 255 * alpha - (alpha - found[:, 3:]) * model.behind
    for k in range(3):
        low, high = image[:, k] == 0, image[:, k] == 255

        def errors(change, k=k, low=low, high=high):
            error = found @ (np.eye(3, 4)[k] + change) - wanted[:, k]
            beyond = (high & (error > 0)) | (low & (error < 0))
            return np.append(np.where(beyond, 0, error), np.sqrt(1e-4 * len(found)) * change)

        best = scipy.optimize.least_squares(errors, np.zeros(4)).x
        np.testing.assert_allclose(
            model.appearances[view][k], np.eye(3, 4)[k] + best, atol=2e-3
        )  # four rounds end near the best map


def test_a_clean_scene_loses_little(scenes):
    clean = scenes[0]
    plain = fit(clean, GRID, steps=300, progress=False)
    mapped = fit(clean, GRID, steps=300, appearance="affine", progress=False)
    assert evaluate(mapped, clean).psnr.mean() > evaluate(plain, clean).psnr.mean() - 0.3


def test_the_light_of_a_new_photograph(scenes, model):
    """Fitted on the left half, judged on the right one."""
    clean, _ = scenes
    view = int(np.flatnonzero(clean.test)[0])
    image = clean.images[view].copy()
    image[..., :3] = np.round(image[..., :3] * [0.9, 0.7, 0.8] + [0, 20, 5])
    left = np.zeros(image.shape[:2], bool)
    left[:, :12] = True
    light = fit_appearance(model, image, clean.cameras, view, mask=left)
    truth = image[..., :3] / 255 * (image[..., 3:] / 255) + 1 - image[..., 3:] / 255

    def right(picture):
        return psnr(picture.color[:, 12:], truth[:, 12:])

    fitted = right(render(model, clean.cameras, view, appearance=light))
    assert fitted > right(render(model, clean.cameras, view)) + 2
    again = fit_appearance(model, image, clean.cameras, view)
    assert np.abs(again - light).max() < 0.5
    assert light.shape == (3, 4)


@pytest.mark.parametrize(
    "field",
    [GRID, HashField(levels=8, table_bits=10, samples=2**11, rays=128, cells=32)],
    ids=["voxel", "hash"],
)
def test_runs_are_equal_and_go_on(scenes, tmp_path, monkeypatch, field):
    file, options = tmp_path / "model.npz", {"steps": 40, "progress": False}
    straight = fit(scenes[1], field, appearance="affine", background="learnt", **options)
    with monkeypatch.context() as patch:
        interrupt(patch, 21, press_ctrl_c)
        fit(scenes[1], field, appearance="affine", background="learnt", checkpoint=file, **options)
    on = fit(scenes[1], field, background="learnt", checkpoint=file, resume=True, **options)
    assert same(on, straight)
    np.testing.assert_array_equal(on.appearances, straight.appearances)
    on.save(file)
    read = load_model(file)
    np.testing.assert_array_equal(read.appearances, on.appearances)
    assert (read.appearance, read.gauge) == ("affine", 0)
    assert np.abs(on.appearances - np.eye(3, 4)).max() > 0.003
    seen, wanted = (render(m, scenes[1].cameras, 3).color for m in (read, on))
    np.testing.assert_array_equal(seen, wanted)


def test_planes_and_films(tmp_path):
    scene = changed(make_scene(train=6, test=1, size=24, layout="forward"), "color")
    field = PlanesField(planes=3, rays=128)
    model = fit(scene, field, steps=10, appearance="affine", gauge=2, progress=False)
    assert model.gauge == 2
    share = np.linspace(0, 1, 3)[:, None, None]
    lights = (1 - share) * model.appearances[0] + share * model.appearances[4]
    film = tmp_path / "film.gif"
    render_path(model, scene.cameras.select(slice(3)), film, appearance=lights)
    assert film.stat().st_size > 0


def test_refusals(scenes, model):
    clean, _ = scenes
    held = int(np.flatnonzero(clean.test)[0])
    image = clean.images[0]
    for message, given in (
        ("appearance must be one of", {"appearance": "linear"}),
        ("appearance must be 'affine' for a field without", {"appearance": "embedding"}),
        ("gauge must go with an appearance, got 1 alone", {"gauge": 1}),
        ("gauge must be a photograph that is trained on", {"appearance": "affine", "gauge": held}),
        ("gauge must be in", {"appearance": "affine", "gauge": 18}),
    ):
        options: Any = {"steps": 1, **given}
        with pytest.raises(ValueError, match=message):
            fit(clean, GRID, **options)
    for light in (np.zeros((2, 4)), np.full((3, 4), np.nan), 99):
        with pytest.raises(ValueError, match="appearance must be"):
            render(model, clean.cameras, appearance=light)
    with pytest.raises(ValueError, match="appearance must have one light for each of 18 frames"):
        render_path(model, clean.cameras, "film.gif", appearance=np.zeros((2, 3, 4)))
    with pytest.raises(TypeError, match="image must be uint8"):
        fit_appearance(model, image / 255, clean.cameras)
    with pytest.raises(ValueError, match=r"image must have shape \(24, 24, 3\)"):
        fit_appearance(model, image[:4], clean.cameras)
    with pytest.raises(ValueError, match="mask must choose a pixel"):
        fit_appearance(model, image, clean.cameras, mask=np.zeros((24, 24), bool))
    with pytest.raises(TypeError, match="mask must be bool"):
        fit_appearance(model, image, clean.cameras, mask=np.ones((24, 24)))


def test_colours_are_the_same_from_all_sides_at_first(scenes, monkeypatch):
    """Or a field takes the light of each photograph for one more side of the scene."""
    field, aside = HashField(levels=8, table_bits=10, samples=2**11, rays=128, cells=32), []
    evaluate_samples = HashNetwork.evaluate

    def noting(self, directions, samples):
        aside.append(self._sides is not None)
        assert aside[-1] == (directions is self._sides)
        evaluate_samples(self, directions, samples)

    monkeypatch.setattr(HashNetwork, "evaluate", noting)
    lights = []
    fit(
        scenes[1], field, steps=40, appearance="affine", progress=False,
        callback=lambda step, loss, model: lights.append(model.appearances),
    )  # fmt: skip
    assert sum(aside) == 32  # There are 40 steps, in blocks of 16.
    assert (lights[0] != lights[1]).any()  # after 16 and 32 steps
    np.testing.assert_array_equal(lights[1][1:], lights[-1][1:])  # then they stay
    assert not any(aside[aside.index(False) :])
    aside.clear()
    fit(scenes[1], field, steps=2, progress=False)
    assert not any(aside)


@pytest.mark.usefixtures("backend")
def test_clipped_channels_are_bounds():
    """A channel of 0 or 255 of an opaque pixel has no error beyond it, and any within."""
    rt = runtime()
    color = np.array([[1.3, -0.2, 0.5], [0.9, 0.1, 0.5], [1.3, -0.2, 0.5], [1.3, -0.2, 0.5]])
    targets = np.array([[1.0, 0, 0.2, 1], [1, 0, 0.2, 1], [1, 0, 0.2, 0.5], [0.9, 0.1, 0.2, 1]])
    seen, opacity, photos, active = on_device(rt, color, np.ones(4), targets, np.array([4]))
    step, black = owned(rt, np.zeros(1, np.int32)), rt.zeros((3,))
    errors, d_opacity = rt.zeros((4,)), rt.zeros((4,))
    d_color, d_learnt = rt.zeros((4, 3)), rt.zeros((4, 3))
    wanted = color - targets[:, :3] * targets[:, 3:]
    for censored in (False, True):
        comparison = Comparison(Background.BLACK, black, 0.0, 3.0, 0, step, censored)
        rt.radiance.training.losses.loss(
            seen, opacity, photos, active, comparison, errors, d_color, d_opacity, d_learnt
        )
        if censored:
            wanted[0, :2] = 0
        np.testing.assert_allclose(rt.to_numpy(d_color), 2 * wanted, atol=CLOSE)
        np.testing.assert_allclose(rt.to_numpy(errors), (wanted**2).mean(1), atol=CLOSE)
