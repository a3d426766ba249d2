"""Clipping of the gradients of a field, by the norm of all of them together."""

from dataclasses import replace

import numpy as np
import pytest

from cvkern._runtime import runtime
from cvkern.radiance import HashField, VoxelField, fit, make_scene
from cvkern.radiance.fields.field import Frame, Learning
from cvkern.radiance.fields.hash import BETAS, HashNetwork
from cvkern.radiance.fields.parameters import Clip
from cvkern.radiance.scenes.photographs import Bounds
from tests.radiance.runs import FIELDS, GRID, TINY, same

F32, I32 = np.float32, np.int32


@pytest.fixture(scope="module")
def scene():
    return make_scene(train=16, test=2, size=24)


def parts(field):
    """Return the arrays of Adam: gradients with their means."""
    if isinstance(field, HashNetwork):
        return [(p.gradients, p.mean) for p in (field.table, field.layers)]
    density, color = field._density_means[0], field._color_means[0]
    field.rt.write(field.touched, np.ones(field.touched.shape, np.uint8))
    return [(field.d_density, density), (field.d_color, color)]


@FIELDS
@pytest.mark.parametrize("most", [None, 0.3, 1e9])
def test_the_norm_is_of_all_gradients_as_the_loss_has_them(backend, field, most):
    plain = {"weight_decay": 0.0, "table_decay": 0.0} if field is TINY else {"smooth_color": 0.0}
    rt, rng = runtime(np.empty(0)), np.random.default_rng(0)
    frame = Frame(Bounds((0.0, 0.0, 0.0), 1.0, False), 0.5, 4.0)
    made = replace(field, gradient_clip=most, **plain).build(rt, frame, 0)
    made.gradient_scale = 4.0
    given = []
    for gradients, _ in parts(made):
        values = rng.normal(size=gradients.shape).astype(F32)
        rt.write(gradients, values)
        given.append(values.ravel() / 8)
    made.learn(Learning(rt.zeros((1,), I32), rt.zeros((1,)), 0.5))
    # The first means are this share of the gradients that Adam was given.
    found = [rt.to_numpy(mean).ravel() / (1 - BETAS[0]) for _, mean in parts(made)]
    want = np.concatenate(given).astype(float)
    norm = np.linalg.norm(want)
    assert norm > 1
    want *= min(1.0, (most or np.inf) / norm)
    np.testing.assert_allclose(np.concatenate(found), want, rtol=1e-4, atol=1e-7)


@FIELDS
def test_training_with_clipping(backend, scene, field):
    free, loose, tight = (
        fit(scene, replace(field, gradient_clip=most), steps=20) for most in (None, 1e9, 1e-6)
    )
    assert same(free, loose)
    assert not same(free, tight)
    # Adam does not see a factor that all gradients have: it learns nearly as well.
    assert tight.training.marks[-1].test_psnr > free.training.marks[-1].test_psnr - 2


def test_factor(backend):
    rt = runtime(np.empty(0))
    clip = Clip(rt, 2.0)
    three, four = rt.zeros((1,)), rt.zeros((1, 1))
    rt.write(three, np.full(1, 3, F32))
    rt.write(four, np.full((1, 1), 4, F32))
    for scale, want in ((0.1, 0.1), (1.0, 0.4), (8.0, 0.4)):  # the norm is 5
        clip.update(scale, three, four)
        np.testing.assert_allclose(rt.to_numpy(clip.factor), want, rtol=1e-6)


@pytest.mark.parametrize("kind", [HashField, VoxelField])
def test_errors(kind):
    for value, rule in ((0, "> 0, got 0"), (-1.0, "> 0, got -1.0"), (np.nan, "finite, got nan")):
        with pytest.raises(ValueError, match=f"gradient_clip must be {rule}"):
            kind(gradient_clip=value)
    with pytest.raises(TypeError, match="gradient_clip must be a number, got 'all'"):
        kind(gradient_clip="all")
    assert kind(gradient_clip=2).gradient_clip == 2


def test_clipping_is_saved(scene, tmp_path):
    field = replace(GRID, gradient_clip=0.5)
    fit(scene, field, steps=2, checkpoint=tmp_path / "model.npz")
    on = fit(scene, field, steps=4, checkpoint=tmp_path / "model.npz", resume=True)
    assert on.settings == field
    with pytest.raises(ValueError, match="checkpoint must be of the same field"):
        fit(scene, GRID, steps=5, checkpoint=tmp_path / "model.npz", resume=True)
