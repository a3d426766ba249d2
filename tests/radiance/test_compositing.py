"""Public compositing: definitions, closed forms, slopes, and the arrays of other libraries."""

import numpy as np
import pytest

import cvkern
from cvkern.radiance import Composite, composite_rays, composite_rays_backward
from tests.radiance import reference_radiance as reference
from tests.radiance.test_primitives_compositing import BRANCHES, along, bundle, draw, inner

F32, I32 = np.float32, np.int32
LIBRARIES = ["torch", "jax", "warp"]


def give(library, array):
    """Return an array of `library` on the CPU."""
    module = pytest.importorskip(library)
    if library == "torch":
        return module.from_numpy(array.copy())
    if library == "jax":
        return module.device_put(array, module.devices("cpu")[0])
    return module.array(array, device="cpu")


@pytest.mark.parametrize("branch", BRANCHES)
def test_each_branch(backend, branch):
    thickness, stop = BRANCHES[branch]
    samples = along(thickness)
    got = composite_rays(*samples, stop=stop)
    # Sums of up to 24 weights, each rounded to 24 digits, by distances up to 5.
    for ours, want in zip(got, reference.composite(*samples, stop), strict=True):
        assert ours.dtype == F32
        np.testing.assert_allclose(ours, want, rtol=1e-6, atol=2e-6)
    gradients = Composite(*draw(1))
    d_density, d_color = composite_rays_backward(gradients, *samples, stop=stop)
    density, color, distances, spans = samples

    def loss(s, c):
        return inner(gradients, reference.composite(s, c, distances, spans, stop))

    own = slice(1, 1 + len(thickness))
    for found, want in (
        (d_density, reference.slope(lambda s: loss(s, color), density)),
        (d_color, reference.slope(lambda c: loss(density, c), color)),
    ):
        np.testing.assert_allclose(found[own], want[own], rtol=2e-5, atol=5e-6)
        assert not np.delete(found, np.arange(own.start, own.stop), 0).any()  # rows of no ray


@pytest.mark.parametrize("density", [0.2, 2.0, 30.0])
@pytest.mark.parametrize("count", [1, 7, 400])
def test_homogeneous_slab(backend, density, count):
    """Opacity 1 - exp(-s L) in any number of pieces; the rest by integrals if thin."""
    length, near = 1.5, 2.0
    middles = near + (np.arange(count) + 0.5) * length / count
    color = np.tile([0.25, 0.5, 2.0], (count, 1))
    got = composite_rays(
        np.full(count, density), color, np.stack([middles, np.full(count, length / count)], 1),
        [[0, count]], stop=0,
    )  # fmt: skip
    left = np.exp(-density * length)
    # An exponential near 1 may be off by 2^-23, in each of up to 400 weights.
    atol = 400 * 2.0**-23
    np.testing.assert_allclose(got.opacity, [1 - left], rtol=0, atol=atol)
    np.testing.assert_allclose(got.color, color[:1] * (1 - left), rtol=0, atol=2 * atol)
    if count == 400:
        mean = near * (1 - left) + (1 - left) / density - left * length
        spread = (1 - left**2) / density - 2 * left * length
        # A thick piece has its light before its middle, by up to s h^2 / 12 of h = L / 400.
        bias = density * (length / count) ** 2 / 12
        np.testing.assert_allclose(got.depth, [mean], rtol=0, atol=4 * atol + bias)
        np.testing.assert_allclose(got.distortion, [spread], rtol=0, atol=8 * atol + 2 * bias)


def test_the_backward_pass_is_the_transpose_of_the_forward_pass(backend):
    """<g, J v> = <J^T g, v>: the function is linear in the colours, and nearly so in a step."""
    density, color, distances, spans = bundle(100)
    rng = np.random.default_rng(4)
    gradients = Composite(*draw(len(spans)))
    v, u = rng.normal(size=density.shape), rng.normal(size=color.shape)
    v[density > 1000] = 0  # opaque: of slope 0, but a step of 1e-3 is not small there
    ahead, behind = (
        reference.composite(density + e * v, color + e * u, distances, spans, 0.0)
        for e in (1e-3, -1e-3)
    )
    want = inner(gradients, [(a - b) / 2e-3 for a, b in zip(ahead, behind, strict=True)])
    found = composite_rays_backward(gradients, density, color, distances, spans, stop=0)
    products = np.concatenate([(found.density * v).ravel(), (found.color * u).ravel()])
    assert abs(products.sum() - want) < 1e-5 * np.abs(products).sum()


@pytest.mark.parametrize("name", Composite._fields)
def test_gradients_that_are_left_out_are_zero(backend, name):
    samples, gradients = bundle(20), Composite(*draw(20))
    alone = Composite(None, None, None, None)._replace(**{name: getattr(gradients, name)})
    padded = Composite(*(g if f == name else 0 * g for f, g in gradients._asdict().items()))
    found, want = (composite_rays_backward(g, *samples) for g in (alone, padded))
    assert found.density.any()
    assert found.color.any() == (name == "color")
    for a, b in zip(found, want, strict=True):
        np.testing.assert_array_equal(a, b)


def test_rays_and_samples_in_any_order(backend):
    density, color, distances, spans = bundle(30)
    want = composite_rays(density, color, distances, spans)
    order = np.random.default_rng(5).permutation(30)
    for a, b in zip(composite_rays(density, color, distances, spans[order]), want, strict=True):
        np.testing.assert_array_equal(a, b[order])
    gradients = Composite(*draw(30))
    found = composite_rays_backward(gradients, density, color, distances, spans)
    gradients = Composite(*(g[order] for g in gradients))
    again = composite_rays_backward(gradients, density, color, distances, spans[order])
    for a, b in zip(found, again, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(("samples", "rays"), [(0, 3), (4, 0), (0, 0), (4, 2)])
def test_nothing_to_see(backend, samples, rays):
    given = (
        np.ones(samples), np.ones((samples, 3)), np.ones((samples, 2)), np.zeros((rays, 2), int)
    )  # fmt: skip
    seen = composite_rays(*given)
    assert [a.shape for a in seen] == [(rays, 3), (rays,), (rays,), (rays,)]
    assert not any(a.any() for a in seen)
    found = composite_rays_backward(seen, *given)
    assert [a.shape for a in found] == [(samples,), (samples, 3)]
    assert not any(a.any() for a in found)


@pytest.mark.parametrize("which", [0, 1, 2])
def test_nan_is_of_its_ray_alone(backend, which):
    samples = bundle(30)
    samples[0][...] = samples[0].clip(0, 5)  # light gets to every sample
    want = composite_rays(*samples)
    ray = int(samples[3][:, 1].argmax())
    samples[which][samples[3][ray, 0] + 5] = np.nan
    got = composite_rays(*samples)
    assert np.isnan(got.color[ray] if which < 2 else got.depth[ray]).all()
    for a, b in zip(got, want, strict=True):
        np.testing.assert_array_equal(np.delete(a, ray, 0), np.delete(b, ray, 0))


@pytest.mark.parametrize("library", LIBRARIES)
def test_arrays_of_other_libraries(backend, library):
    samples, gradients = bundle(40), draw(40)
    given = [give(library, a) for a in samples]
    incoming = Composite(*(give(library, a) for a in gradients))
    for got, want in (
        (composite_rays(*given), composite_rays(*samples)),
        (
            composite_rays_backward(incoming, *given),
            composite_rays_backward(Composite(*gradients), *samples),
        ),
    ):
        for a, b in zip(got, want, strict=True):
            assert type(a) is type(given[0])
            np.testing.assert_array_equal(np.asarray(a), b)
    for array, before in zip(given, samples, strict=True):  # inputs are never written
        np.testing.assert_array_equal(np.asarray(array), before)


def test_other_dtypes_and_layouts(backend):
    density, color, distances, spans = bundle(40)
    want = composite_rays(density, color, distances, spans)
    for other in (
        (density.astype(float), color.astype(float), distances.astype(float), spans.astype("i8")),
        (density[::-1].copy()[::-1], np.asfortranarray(color), distances.astype(">f4"),
         spans.astype("u2")),
        (density.tolist(), color.tolist(), distances.tolist(), spans.tolist()),
    ):  # fmt: skip
        for a, b in zip(composite_rays(*other), want, strict=True):
            np.testing.assert_array_equal(a, b)


def test_a_replay_does_not_look_at_values(backend):
    density, color, distances, spans = bundle(20)
    replay = cvkern.capture(composite_rays, density, color, distances, spans, check=False)
    density *= F32(0.5)
    spans[3:, 1] //= 2
    for a, b in zip(replay(), composite_rays(density, color, distances, spans), strict=True):
        np.testing.assert_array_equal(a, b)


def test_what_torch_derives(backend):
    """The definition in float64, differentiated by PyTorch."""
    torch = pytest.importorskip("torch")
    rng, count = np.random.default_rng(6), 50
    lengths = rng.uniform(0.01, 0.05, count)
    distances = np.stack([1 + np.cumsum(lengths), lengths], 1).astype(F32)
    density, color = rng.exponential(5.0, count).astype(F32), rng.random((count, 3)).astype(F32)
    gradients = Composite(*draw(1))

    s, c = (torch.tensor(a, dtype=torch.float64, requires_grad=True) for a in (density, color))
    t, d = torch.tensor(distances, dtype=torch.float64).T
    thickness = s * d
    w = torch.exp(thickness - torch.cumsum(thickness, 0)) * (1 - torch.exp(-thickness))
    spread = (w * w[:, None] * (t - t[:, None]).abs()).sum() + (w * w * d).sum() / 3
    seen = (w @ c)[None], w.sum()[None], (w @ t)[None], spread[None]
    losses = [(torch.tensor(g) * a).sum() for g, a in zip(gradients, seen, strict=True)]
    torch.stack(losses).sum().backward()
    got = composite_rays_backward(gradients, density, color, distances, [[0, count]], stop=0)
    # Sums of 50 terms below 10, each of 24 digits.
    np.testing.assert_allclose(got.density, s.grad, rtol=2e-5, atol=5e-6)
    np.testing.assert_allclose(got.color, c.grad, rtol=2e-5, atol=5e-6)
