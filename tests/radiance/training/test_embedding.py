"""The light of photographs as inputs of perceptrons: sums of gradients, training, new light."""

import numpy as np
import pytest

from cvkern._runtime import runtime
from cvkern.kernels.codes.radiance import LIGHT, Composited, Rays
from cvkern.radiance import (
    HashField,
    MLPField,
    evaluate,
    fit,
    fit_appearance,
    load_model,
    make_scene,
    march,
    psnr,
    render,
    render_path,
)
from cvkern.radiance.fields.field import Frame
from cvkern.radiance.rendering import owned, photograph
from cvkern.radiance.scenes.photographs import Bounds
from cvkern.radiance.wild.embeddings import Embedding
from profiling.experiments.wild_quality import changed
from tests.radiance.runs import TINY, interrupt, press_ctrl_c, same

RAYS, ACTIVE, IMAGES = 50, 45, 4
DEEP = MLPField(
    width=16, layers=2, skip=1, frequencies=2, view_frequencies=1, samples=2**12, rays=RAYS,
    cells=8, steps=64,
)  # fmt: skip
FLAT = HashField(levels=8, table_bits=8, coarsest=2, finest=8, samples=2**12, rays=RAYS, cells=8,
                 steps=64)  # fmt: skip


@pytest.mark.usefixtures("backend")
def test_gradients_are_summed_by_photographs():
    rt, rng = runtime(), np.random.default_rng(0)
    counts = rng.integers(0, 5, RAYS)
    spans = np.column_stack((np.cumsum(counts) - counts, counts)).astype(np.int32)
    samples = rng.normal(size=(counts.sum() + 3, LIGHT))
    views = rng.integers(0, IMAGES - 1, RAYS)  # the last one is not seen
    d_rays, d_table = rt.zeros((RAYS, LIGHT)), owned(rt, np.full((IMAGES, LIGHT), 7, np.float32))
    active = owned(rt, np.array([ACTIVE], np.int32))
    rt.radiance.wild.embeddings.sum_rays(
        owned(rt, samples.astype(np.float32)), owned(rt, spans), active, d_rays
    )
    rays = np.array([samples[b : b + n].sum(0) for b, n in spans])
    rays[ACTIVE:] = 0
    np.testing.assert_allclose(rt.to_numpy(d_rays), rays, atol=1e-5)  # sums of 4 numbers up to 4
    rt.radiance.wild.embeddings.sum_views(
        d_rays, owned(rt, views.astype(np.int32)), active, rt.zeros((7, IMAGES, LIGHT)), d_table
    )
    wanted = np.array([rays[views == view].sum(0) for view in range(IMAGES)])
    np.testing.assert_allclose(rt.to_numpy(d_table), wanted, atol=1e-5)
    assert not rt.to_numpy(d_table)[-1].any()


@pytest.mark.parametrize("settings", [FLAT, DEEP], ids=["hash", "mlp"])
def test_gradients_are_central_differences(settings, backend, monkeypatch):
    """By the lights of photographs, through the whole field."""
    monkeypatch.setattr(march, "STOP", 0.0)  # or a step changes which sample is a ray's last
    rt, rng = runtime(), np.random.default_rng(0)
    field = settings.build(rt, Frame(Bounds((0, 0, 0), 1.0, False), 0.5, 4.0), 0, lit=True)
    lights = Embedding(rt, IMAGES, RAYS)
    views = owned(rt, rng.integers(0, IMAGES, RAYS).astype(np.int32))
    origins = rng.normal(size=(RAYS, 3))
    origins *= 2 / np.linalg.norm(origins, axis=1, keepdims=True)
    towards = rng.uniform(-0.5, 0.5, (RAYS, 3)) - origins
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    gradients = [rng.normal(size=(RAYS, 3)), *np.zeros((3, RAYS))]
    active = owned(rt, np.array([ACTIVE], np.int32))
    rays = Rays(*(owned(rt, a.astype(np.float32)) for a in (origins, towards)), active)
    table = rng.normal(size=(IMAGES, LIGHT)).astype(np.float32)

    def loss(values):
        rt.write(lights.table.values, values.astype(np.float32))
        field.light(lights.lights(views))
        found = field.forward(rays, owned(rt, np.ones(1, np.int32)))
        return (rt.to_numpy(found.color)[:ACTIVE] * gradients[0][:ACTIVE]).sum()

    loss(table)
    scale = field.gradient_scale
    field.backward(Composited(*(owned(rt, (scale * g).astype(np.float32)) for g in gradients)))
    lights.backward(field, views, active)
    found = rt.to_numpy(lights.table.gradients).copy() / scale
    assert np.linalg.norm(found, axis=1).min() > 1e-3
    unit = found / np.linalg.norm(found)
    across = rng.normal(size=unit.shape)
    for direction in (unit, unit + across / np.linalg.norm(across)):
        step = 0.01  # short: where a rectifier switches, the slope jumps
        slope = (loss(table + step * direction) - loss(table - step * direction)) / (2 * step)
        # The loss, some 10, is rounded to 1e-6 in all, and changes by 1e-3 at least.
        assert abs((found * direction).sum() - slope) < 1e-2 * abs(slope)


@pytest.fixture(scope="module")
def scenes():
    clean = make_scene(train=16, test=2, size=24)
    return clean, changed(clean, "color")


@pytest.fixture(scope="module")
def model(scenes):
    return fit(scenes[1], TINY, steps=400, appearance="embedding", progress=False)


def test_changed_light_is_told_from_the_scene(scenes, model, tmp_path):
    clean, wild = scenes
    plain = fit(wild, TINY, steps=400, progress=False)
    told, without = (evaluate(m, wild).psnr.mean() for m in (model, plain))
    assert told > without + 1
    views = np.flatnonzero(~clean.test)[1:].tolist()
    gains = []
    for view in views:
        truth = photograph(wild, view, model.behind)
        own = render(model, wild.cameras, view, appearance=view).color
        other = render(model, wild.cameras, view).color
        gains.append(psnr(own, truth) - psnr(other, truth))
    assert np.mean(gains) > 1.5
    assert model.appearances.shape == (18, LIGHT)
    light = model.appearances[view]
    np.testing.assert_array_equal(own, render(model, wild.cameras, view, appearance=light).color)
    np.testing.assert_array_equal(
        other, render(model, wild.cameras, view, appearance=model.gauge).color
    )
    # Half way between two lights, colours are between, on the whole.
    middle = (light + model.appearances[model.gauge]) / 2
    half = render(model, wild.cameras, view, appearance=middle).color.mean()
    assert min(own.mean(), other.mean()) < half < max(own.mean(), other.mean())
    share = np.linspace(0, 1, 3)[:, None]
    film = tmp_path / "film.gif"
    lights = (1 - share) * light + share * model.appearances[model.gauge]
    render_path(model, wild.cameras.select(slice(3)), film, appearance=lights)
    assert film.stat().st_size > 0
    for wrong in (np.zeros((3, 4)), np.full(LIGHT, np.inf)):
        with pytest.raises(ValueError, match="appearance must be"):
            render(model, wild.cameras, appearance=wrong)


def test_the_light_of_a_new_photograph(scenes, model):
    """Fitted on the left half, judged on the right one, with the light of another photograph."""
    clean = scenes[0]
    view = int(np.flatnonzero(clean.test)[0])
    other = int(np.flatnonzero(~clean.test)[5])
    seen = render(model, clean.cameras, view, appearance=other).color
    image = np.round(255 * seen).astype(np.uint8)
    left = np.zeros(image.shape[:2], bool)
    left[:, :12] = True
    light = fit_appearance(model, image, clean.cameras, view, mask=left)
    assert light.shape == (LIGHT,)
    truth = image[:, 12:] / 255
    fitted, gauge = (
        psnr(render(model, clean.cameras, view, appearance=a).color[:, 12:], truth)
        for a in (light, None)
    )
    assert fitted > max(gauge + 3, 30)


def test_runs_are_equal_and_go_on(scenes, tmp_path, monkeypatch):
    file, options = tmp_path / "model.npz", {"steps": 40, "progress": False, "seed": 1}
    wild, how = scenes[1], {"appearance": "embedding", "gauge": 2, "robust": True}
    straight = fit(wild, TINY, **how, **options)
    with monkeypatch.context() as patch:
        interrupt(patch, 21, press_ctrl_c)
        fit(wild, TINY, checkpoint=file, **how, **options)
    on = fit(wild, TINY, checkpoint=file, resume=True, **options)
    assert same(on, straight)
    np.testing.assert_array_equal(on.appearances, straight.appearances)
    assert np.abs(on.appearances).max() > 0.01
    on.save(file, resumable=False)
    read = load_model(file)
    assert (read.appearance, read.gauge) == ("embedding", 2)
    np.testing.assert_array_equal(read.appearances, on.appearances)
    with pytest.raises(ValueError, match="levels must be at most 24 for appearance='embedding'"):
        fit(wild, HashField(levels=32), steps=1, appearance="embedding")
