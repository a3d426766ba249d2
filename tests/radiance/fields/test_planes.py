"""Rays through parallel planes and their gradients, against NumPy in float64."""

from typing import Any

import numpy as np
import pytest

from cvkern._runtime import runtime
from cvkern.kernels.codes.radiance import AdamRule, Learnt, Rays, Seen, Shine
from cvkern.radiance.rendering import owned
from tests.radiance.fields.reference_planes import logistic, render, value

RAYS, ACTIVE, SHAPE = 40, 38, (5, 7, 9)
SHARED, REACH = 3, 2.0  # planes that share coefficients, and the unit of offsets, texels
TURN = 0.1
PLACE = np.array([
    np.cos(TURN), 0, -np.sin(TURN), 0.1, 0, 1, 0, 0.05, np.sin(TURN), 0, np.cos(TURN), 0.2,
    6, 6, 4, 3,
])  # fmt: skip
# Sums of 5 samples with some 20 roundings of 2^-24 each, of numbers up to 5.
CLOSE = 1e-5


class Case:
    """Random planes and rays, one that looks back, and one from behind some of the planes."""

    def __init__(self, seed=0):
        rng = np.random.default_rng(seed)
        self.texels = rng.uniform(0, 1, (*SHAPE, 4))
        self.texels[..., 3] *= 0.7
        self.texels[..., :3] *= self.texels[..., 3:]
        self.disparities = np.linspace(1, 0.2, SHAPE[0])
        self.origins = rng.normal(0, 0.2, (RAYS, 3))
        self.directions = rng.normal((0, 0, 1), 0.25, (RAYS, 3))
        self.origins[1] = 0, 0, 1.5
        self.directions[0] *= -1
        self.directions /= np.linalg.norm(self.directions, axis=1, keepdims=True)
        self.gradients = [
            rng.normal(size=(RAYS, 3)), rng.normal(size=RAYS), rng.normal(size=RAYS) / 4,
        ]  # fmt: skip
        # The kernels get numbers in float32, so the reference starts from these.
        self.maps = rng.normal(0, 0.3, (2, (SHAPE[1] - 1) // 2 + 2, (SHAPE[2] - 1) // 2 + 2, 15))
        for name in ("texels", "disparities", "origins", "directions", "maps"):
            setattr(self, name, getattr(self, name).astype(np.float32).astype(np.float64))

    def arrays(self, rt, active=RAYS):
        """Return the arguments of the kernels but the texels."""
        origins, directions = (
            owned(rt, a.astype(np.float32)) for a in (self.origins, self.directions)
        )
        rays = Rays(origins, directions, owned(rt, np.array([active], np.int32)))
        planes = np.concatenate((PLACE, self.disparities)).astype(np.float32)
        return rays, owned(rt, planes)

    def truth(self, texels=None, stop=0.0, maps=None):
        texels = self.texels if texels is None else texels
        place = PLACE.astype(np.float32).astype(np.float64)
        shine = None if maps is None else (maps, SHARED, REACH)
        return render(self.origins, self.directions, self.disparities, place, texels, stop, shine)

    def shine(self, rt):
        return Shine(owned(rt, self.maps.astype(np.float32)), SHARED, REACH)


def seen_by(rt, case, texels, stop=0.0, shine=None):
    seen = Seen(rt.zeros((RAYS, 3)), rt.zeros((RAYS,)), rt.zeros((RAYS,)))
    rt.radiance.fields.planes.rays.render(*case.arrays(rt), texels, shine, stop, 0, seen)
    return seen


@pytest.mark.usefixtures("backend")
def test_compositing_is_the_closed_form():
    rt, case = runtime(), Case()
    seen = seen_by(rt, case, owned(rt, case.texels.astype(np.float32)))
    for found, wanted in zip(seen, case.truth(), strict=True):
        np.testing.assert_allclose(rt.to_numpy(found), wanted, atol=CLOSE)
    opacity = rt.to_numpy(seen.opacity)
    assert opacity[0] == 0  # it looks back
    # The ray that begins at a depth of about 1.7 meets only the planes of depths above that.
    assert 0 < opacity[1] == pytest.approx(case.truth()[1][1], abs=CLOSE)


@pytest.mark.usefixtures("backend")
def test_texels_of_8_bits():
    """Weights in units of 1 / 256 move a point by at most 1 / 512 of a texel along each axis."""
    rt, case = runtime(), Case()
    texels = np.round(255 * case.texels).astype(np.uint8)
    words = owned(rt, np.ascontiguousarray(texels).view("<u4")[..., 0].astype(np.uint32))
    seen = seen_by(rt, case, words)
    for found, wanted in zip(seen[:2], case.truth(texels / 255)[:2], strict=True):
        # A sample is off by 2 / 512 of a difference of 1; so are up to 5 samples of a ray, and the
        # light that they let through.
        np.testing.assert_allclose(rt.to_numpy(found), wanted, atol=0.01)


@pytest.mark.usefixtures("backend")
def test_a_ray_ends_where_little_light_is_left():
    rt, case = runtime(), Case()
    seen = seen_by(rt, case, owned(rt, case.texels.astype(np.float32)), 0.5)
    wanted = case.truth(stop=0.5)
    assert (np.abs(wanted[1] - case.truth()[1]) > 0.01).any()
    np.testing.assert_allclose(rt.to_numpy(seen.opacity), wanted[1], atol=CLOSE)


def gradient(rt, case, stop=0.0, active=RAYS):
    """Return the gradient by the texels."""
    texels = owned(rt, case.texels.astype(np.float32))
    seen, sums = seen_by(rt, case, texels, stop), rt.zeros(case.texels.shape)
    given = Seen(*(owned(rt, g.astype(np.float32)) for g in case.gradients))
    rays, planes = case.arrays(rt, active)
    rt.radiance.fields.planes.rays.render_backward(
        given, rays, planes, texels, None, stop, seen, sums, None
    )
    return rt.to_numpy(sums)


@pytest.mark.usefixtures("backend")
def test_colours_depend_on_the_side():
    rt, case = runtime(), Case(3)
    texels = owned(rt, case.texels.astype(np.float32))
    seen = seen_by(rt, case, texels, shine=case.shine(rt))
    wanted = case.truth(maps=case.maps)
    assert np.abs(wanted[0] - case.truth()[0]).max() > 0.1
    for found, truth in zip(seen, wanted, strict=True):
        np.testing.assert_allclose(rt.to_numpy(found), truth, atol=CLOSE)
    words = np.round(255 * case.texels).astype(np.uint8)
    small = owned(rt, np.ascontiguousarray(words).view("<u4")[..., 0].astype(np.uint32))
    seen = seen_by(rt, case, small, shine=case.shine(rt))
    wanted = case.truth(words / 255, maps=case.maps)
    np.testing.assert_allclose(rt.to_numpy(seen.color), wanted[0], atol=0.02)  # see below


def shine_gradients(rt, case, dtype: Any = np.float32):
    """Return the gradients by texels and by coefficients."""
    texels = owned(rt, case.texels.astype(np.float32))
    shine, given = case.shine(rt), Seen(*(owned(rt, g.astype(np.float32)) for g in case.gradients))
    seen = seen_by(rt, case, texels, shine=shine)
    sums = rt.zeros(case.texels.shape, dtype), rt.zeros(case.maps.shape, dtype)
    rays, planes = case.arrays(rt, ACTIVE)
    rt.radiance.fields.planes.rays.render_backward(
        given, rays, planes, texels, shine, 0.0, seen, *sums
    )
    return [rt.to_numpy(a).copy() for a in sums]


@pytest.mark.usefixtures("backend")
def test_gradients_by_the_side_are_central_differences():
    case = Case(3)
    found = shine_gradients(runtime(), case)

    def loss(texels, maps):
        seen = case.truth(texels, maps=maps)
        return sum((g * a)[:ACTIVE].sum() for g, a in zip(case.gradients, seen, strict=True))

    rng, step = np.random.default_rng(1), 1e-6
    for at, gradient in enumerate(found):
        touched = np.argwhere(gradient != 0)
        assert len(touched) > 300
        for index in map(tuple, touched[rng.choice(len(touched), 20, replace=False)]):
            ends = []
            for e in (step, -step):
                arrays = [case.texels.copy(), case.maps.copy()]
                arrays[at][index] += e
                ends.append(loss(*arrays))
            wanted = (ends[0] - ends[1]) / (2 * step)
            assert gradient[index] == pytest.approx(wanted, rel=1e-4, abs=1e-5), index
    # Coefficients act linearly: <g, J v> = <J^T g, v>.
    change = rng.normal(size=case.maps.shape)
    forward = loss(case.texels, case.maps + change) - loss(case.texels, case.maps)
    assert (found[1] * change).sum() == pytest.approx(forward, rel=1e-5)


@pytest.mark.usefixtures("backend")
def test_gradients_are_central_differences():
    case = Case()
    found = gradient(runtime(), case)

    def loss(texels):
        return sum((g * a).sum() for g, a in zip(case.gradients, case.truth(texels), strict=True))

    rng, step = np.random.default_rng(1), 1e-6
    touched = np.argwhere(found != 0)
    assert len(touched) > 300
    for index in map(tuple, touched[rng.choice(len(touched), 40, replace=False)]):
        up, down = case.texels.copy(), case.texels.copy()
        up[index] += step
        down[index] -= step
        wanted = (loss(up) - loss(down)) / (2 * step)
        assert found[index] == pytest.approx(wanted, rel=1e-4, abs=1e-5), index


@pytest.mark.usefixtures("backend")
def test_the_backward_pass_is_the_transpose_of_the_forward_pass():
    """Colours act linearly: <g, J v> = <J^T g, v>."""
    case = Case(2)
    found = gradient(runtime(), case)
    change = np.random.default_rng(3).normal(size=case.texels.shape)
    change[..., 3] = 0
    moved, still = case.truth(case.texels + change)[0], case.truth()[0]
    forward = (case.gradients[0] * (moved - still)).sum()
    assert (found * change).sum() == pytest.approx(forward, rel=1e-5)


@pytest.mark.usefixtures("backend")
def test_ends_and_rays_that_do_not_count_have_no_gradients():
    rt, case = runtime(), Case()
    assert not gradient(rt, case, active=0).any()
    some = gradient(rt, case, 0.5)
    case.gradients = [2 * g for g in case.gradients]
    np.testing.assert_allclose(gradient(rt, case, 0.5), 2 * some, rtol=1e-5, atol=1e-6)
    assert np.count_nonzero(some) < np.count_nonzero(gradient(rt, case))


@pytest.mark.usefixtures("backend")
def test_adam_goes_through_the_logistic_functions():
    rt, rng = runtime(), np.random.default_rng(4)
    shape = (2, 3, 4, 4)
    parameters, slopes = rng.normal(size=shape), rng.normal(size=shape)
    slopes[0] = 0  # a texel without a gradient keeps what it has
    means, squares = 0.1 * rng.normal(size=shape), 0.1 * rng.random(shape)
    values = value(parameters)
    arrays = [owned(rt, a.astype(np.float32)) for a in (slopes, means, squares, parameters)]
    found, given = rt.zeros(shape), rt.zeros(shape)
    kernels = rt.radiance.fields.planes.texels
    kernels.values(arrays[3], given)
    np.testing.assert_allclose(rt.to_numpy(given), values, atol=1e-6)
    rate, factor = (owned(rt, np.array(a, np.float32)) for a in ([0.1, 0.5, 0.4], [3.0]))
    rule = AdamRule(0.9, 0.99, 1e-15, sparse=True)
    kernels.learn(rate, factor, rule, Learnt(*arrays), given)
    color, opacity = logistic(parameters[..., :3]), values[..., 3:]
    g = 3 * slopes
    chain = np.concatenate(
        (
            opacity * g[..., :3] * color * (1 - color),
            opacity * (1 - opacity) * ((g[..., :3] * color).sum(-1, keepdims=True) + g[..., 3:]),
        ),
        axis=-1,
    )
    mean, square = 0.9 * means + 0.1 * chain, 0.99 * squares + 0.01 * chain**2
    moved = parameters - 0.1 / 0.5 * mean / (np.sqrt(square / 0.4) + 1e-15)
    moved[0] = parameters[0]
    np.testing.assert_allclose(rt.to_numpy(arrays[3]), moved, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(rt.to_numpy(given), value(moved), atol=1e-5)
    np.testing.assert_array_equal(rt.to_numpy(arrays[1])[0], means[0].astype(np.float32))
    assert not rt.to_numpy(arrays[0]).any()
    kernels.values(arrays[3], found)
    np.testing.assert_allclose(rt.to_numpy(found), rt.to_numpy(given), atol=1e-6)
