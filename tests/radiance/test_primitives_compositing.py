"""Compositing along rays and losses: forward against definitions, backward against differences."""

import numpy as np
import pytest

from cvkern.kernels.codes.radiance import Background, Comparison, Composited
from tests.radiance import reference_derived
from tests.radiance import reference_radiance as reference

F32, I32 = np.float32, np.int32

# Optical thickness of the samples of a ray, and what is left of the light where it stops.
BRANCHES = {
    "zero density": ([0.0, 0.0, 0.0], 1e-4),
    "zero density between": ([0.3, 0.0, 0.0, 0.5], 1e-4),
    "opaque first sample": ([60.0, 0.5, 0.5], 1e-4),
    "nearly opaque first sample": ([5.0, 0.5, 0.5], 1e-4),
    "opaque last sample": ([0.2, 0.3, 60.0], 1e-4),
    "one sample": ([0.7], 1e-4),
    "no samples": ([], 1e-4),
    "early stop": ([0.5, 1.0, 1.5, 0.4, 0.4], 0.1),
    "stop at the last sample": ([0.5, 1.0, 1.5], 0.1),
    "transmittance underflows": ([0.5, 200.0, 300.0, 1.0, 0.0], 0.0),
    "little transmittance": ([0.5, 4.0, 1.0, 0.5], 0.0),
    "thin": ([1e-3] * 6, 1e-4),
    "many": (list(np.linspace(0.0, 0.3, 24)), 1e-4),
    "more than a warp": ([0.05] * 40, 1e-4),
    "stop behind 32": ([0.1] * 40, 0.042),
}


def along(thickness, seed=0):
    """Return sigma, rgb and distances of samples of one ray, and some rows of no ray around."""
    rng = np.random.default_rng(seed)
    count = len(thickness)
    steps = rng.uniform(0.05, 0.2, count + 3).astype(F32)
    distances = np.stack([1 + np.cumsum(steps), steps], 1).astype(F32)
    sigma = np.full(count + 3, 5.0)
    sigma[1 : 1 + count] = thickness / steps[1 : 1 + count]
    rgb = rng.random((count + 3, 3)).astype(F32)
    return sigma.astype(F32), rgb, distances, np.array([[1, count]], I32)


def bundle(rays=300, seed=1):
    """Return sigma, rgb, distances and spans of many rays of up to 200 samples."""
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, 200, rays)
    counts[:5] = [0, 1, 0, 2, 1]
    spans = np.stack([np.cumsum(counts) - counts, counts], 1).astype(I32)
    total = counts.sum()
    steps = rng.uniform(0.001, 0.01, total)
    t = np.cumsum(steps) - np.repeat(
        (np.cumsum(steps) - steps)[spans[:, 0].clip(0, total - 1)], counts
    )
    thick = rng.exponential(0.02, total) * (rng.random(total) < 0.7)
    thick[rng.random(total) < 0.005] = 30
    sigma = thick / steps
    return (
        sigma.astype(F32), rng.random((total, 3)).astype(F32),
        np.stack([t, steps], 1).astype(F32), spans,
    )  # fmt: skip


def forward(kernels, sigma, rgb, distances, spans, stop):
    rays = len(spans)
    return kernels(
        "radiance.compositing.forward", sigma, rgb, distances, spans, stop,
        out=[Composited(((rays, 3), F32), ((rays,), F32), ((rays,), F32), ((rays,), F32))],
    )  # fmt: skip


def backward(kernels, gradients, sigma, rgb, distances, spans, stop):
    return kernels(
        "radiance.compositing.backward", Composited(*gradients), sigma, rgb, distances, spans, stop,
        out=[(sigma.shape, F32), (rgb.shape, F32)],
    )  # fmt: skip


def draw(rays, seed=2):
    """Return gradients of colour, opacity, depth and distortion."""
    rng = np.random.default_rng(seed)
    return [rng.normal(size=s).astype(F32) for s in ((rays, 3), rays, rays, rays)]


def inner(gradients, results):
    return sum((g.astype(float) * r).sum() for g, r in zip(gradients, results, strict=True))


@pytest.fixture(params=BRANCHES)
def branch(request):
    thickness, stop = BRANCHES[request.param]
    return *along(thickness), stop


def test_composite_is_its_definition(kernels, branch):
    want = reference.composite(*branch)
    # A weight is a difference of numbers up to 1, rounded to 24 digits; 40 of them are summed, with
    # distances up to 7 of which two are multiplied in the distortion.
    for got, expected in zip(forward(kernels, *branch), want, strict=True):
        np.testing.assert_allclose(got, expected, rtol=1e-6, atol=2e-6)


@pytest.mark.parametrize("which", ["all", "color", "opacity", "depth", "distortion"])
def test_composite_backward_is_the_slope(kernels, branch, which):
    sigma, rgb, distances, spans, stop = branch
    gradients = draw(1)
    if which != "all":
        kept = ["color", "opacity", "depth", "distortion"].index(which)
        gradients = [g if k == kept else 0 * g for k, g in enumerate(gradients)]

    def loss(s, c):
        return inner(gradients, reference.composite(s, c, distances, spans, stop))

    d_sigma, d_rgb = backward(kernels, gradients, *branch)
    own = slice(1, 1 + spans[0, 1])
    want = reference.slope(lambda s: loss(s, rgb), sigma)
    # Sums of up to 40 terms within 10, each rounded to 24 digits; differences are within 1e-9.
    np.testing.assert_allclose(d_sigma[own], want[own], rtol=2e-5, atol=5e-6)
    want = reference.slope(lambda c: loss(sigma, c), rgb)
    np.testing.assert_allclose(d_rgb[own], want[own], rtol=2e-5, atol=2e-6)
    for d in (d_sigma, d_rgb):  # rows of no ray
        assert (np.delete(d, np.arange(own.start, own.stop), 0) == 77).all()


@pytest.mark.parametrize("lit", [1, 3, 31, 32, 33, 64, 65])  # CUDA takes 32 at once
def test_samples_behind_the_stop_have_no_weight_and_no_gradient(kernels, lit):
    sigma, rgb, distances, spans = along([0.1] * 70)
    for array in (sigma, rgb, distances):
        array[1 + lit : 71] = np.nan  # nothing looks at these
    stop = float(np.exp(-0.1 * (lit - 0.5)))
    found = forward(kernels, sigma, rgb, distances, spans, stop)
    assert all(np.isfinite(array).all() for array in found)
    np.testing.assert_allclose(found[1], 1 - np.exp(-0.1 * lit), rtol=0, atol=2e-6)
    d_sigma, d_rgb = backward(kernels, draw(1), sigma, rgb, distances, spans, stop)
    for d in (d_sigma, d_rgb):
        assert (np.abs(d[1 : 1 + lit]) > 0).all()
        assert (d[1 + lit : 71] == 0).all()
        assert (d[71:] == 77).all()


@pytest.mark.parametrize("stop", [0.0, 1e-4, 0.3])
def test_composite_many_rays(kernels, stop):
    given = *bundle(), stop
    for got, want in zip(forward(kernels, *given), reference.composite(*given), strict=True):
        # See above, for 200 samples; the last weight before a stop may be that of neither.
        np.testing.assert_allclose(got, want, rtol=1e-4, atol=2e-5)


@pytest.mark.parametrize("stop", [0.0, 1e-4, 0.3])
def test_composite_backward_is_the_transpose(kernels, stop):
    """<gradients, J v> = <J^T gradients, v> for steps v of densities and colours."""
    sigma, rgb, distances, spans = bundle()
    gradients = draw(len(spans))
    rng = np.random.default_rng(3)
    v, u = rng.normal(size=sigma.shape), rng.normal(size=rgb.shape)
    v[sigma > 1000] = 0  # opaque ones: their slope is 0, but a step of 1e-3 is not small
    step = 1e-3
    ahead, behind = (
        reference.composite(sigma + e * v, rgb + e * u, distances, spans, stop)
        for e in (step, -step)
    )
    # Where a step changes which sample is the last, the function has a jump: not those rays.
    smooth = np.abs(ahead[1] - behind[1]) < 0.05
    assert smooth.mean() > 0.9
    gradients = [g * (smooth if g.ndim == 1 else smooth[:, None]) for g in gradients]
    want = inner(gradients, [(a - b) / (2 * step) for a, b in zip(ahead, behind, strict=True)])
    d_sigma, d_rgb = backward(
        kernels, [g.astype(F32) for g in gradients], sigma, rgb, distances, spans, stop
    )
    got = (d_sigma.astype(float) * v).sum() + (d_rgb.astype(float) * u).sum()
    size = np.abs(d_sigma * v).sum() + np.abs(d_rgb * u).sum()
    assert abs(got - want) < 1e-5 * size


@pytest.mark.parametrize("count", [1, 2, 40])
def test_composite_backward_is_what_warp_derives(kernels, count):
    rng = np.random.default_rng(count)
    sigma, rgb, distances, spans = along(rng.exponential(0.1, count))
    gradients = draw(1)
    d_sigma, d_rgb = backward(kernels, gradients, sigma, rgb, distances, spans, 0.0)

    own = slice(1, 1 + count)
    g = np.concatenate([a.ravel() for a in gradients])
    want_sigma, want_rgb = reference_derived.composite_backward(
        g, sigma[own], rgb[own], distances[own]
    )
    # Both in float32, in sums of count^2 terms.
    np.testing.assert_allclose(d_sigma[own], want_sigma, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(d_rgb[own], want_rgb, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("density", [0.3, 4.0, 40.0])
def test_homogeneous_slab(kernels, density):
    """A slab from 1 to 1 + L of density s: w(x) = s exp(-s x), of which all sums are known."""
    length, count, near = 1.5, 1000, 1.0
    steps = np.full(count, length / count, F32)
    t = near + (np.arange(count) + 0.5) * length / count
    rgb = np.tile(np.array([0.2, 0.5, 0.9], F32), (count, 1))
    color, opacity, depth, distortion = forward(
        kernels, np.full(count, density, F32), rgb, np.stack([t, steps], 1).astype(F32),
        np.array([[0, count]], I32), 0.0,
    )  # fmt: skip
    left = np.exp(-density * length)
    # An exponential near 1 is off by up to 2^-24, and with it a weight of s h; 1000 of them are
    # subtracted from what is left, and summed: 1000 * 2^-24 of a sum near 1, here of 0.36 at least.
    rtol = 2.0**-24 * (1 / (density * length / count) + 1000 / 0.36)
    # Opacities of pieces are together that of the whole.
    np.testing.assert_allclose(opacity, 1 - left, rtol=rtol)
    np.testing.assert_allclose(color[0], rgb[0] * (1 - left), rtol=rtol)
    # Light of a piece comes from before its middle by up to s h^2 / 12, of h = L / 1000.
    mean = near * (1 - left) + (1 - left) / density - left * length
    bias = density * (length / count) ** 2 / 12
    np.testing.assert_allclose(depth, mean, rtol=rtol, atol=bias)
    # The distortion has the errors of two weights in each term.
    spread = (1 - left**2) / density - 2 * left * length
    np.testing.assert_allclose(distortion, spread, rtol=1e-3)


# ---------------------------------------------------------------------------------------- losses


def loss(kernels, color, opacity, targets, active, kind, learnt, huber, scale=1.0, seed=4, step=9):
    rays = len(opacity)
    return kernels(
        "radiance.training.losses.loss",
        color,
        opacity,
        targets,
        np.array([active], I32),
        Comparison(kind, learnt, huber, scale, seed, np.array([step], I32)),
        out=[((rays,), F32), ((rays, 3), F32), ((rays,), F32), ((rays, 3), F32)],
    )


def seen(rays, seed=5):
    """Return colours, opacities and targets, with what is transparent and what is opaque."""
    rng = np.random.default_rng(seed)
    opacity, targets = rng.random(rays), rng.random((rays, 4))
    opacity[:4], targets[2:6, 3] = [0, 1, 0, 1], [0, 0, 1, 1]
    return rng.random((rays, 3)).astype(F32), opacity.astype(F32), targets.astype(F32)


@pytest.mark.parametrize("huber", [0.0, 0.05, 0.4, 5.0])  # errors on both sides, and on either
@pytest.mark.parametrize("kind", Background)
def test_loss_and_its_slopes(kernels, kind, huber):
    rays, active, scale = 12, 10, 128.0
    color, opacity, targets = seen(rays)
    learnt = np.array([0.3, 0.6, 0.1], F32)
    errors, d_color, d_opacity, d_learnt = loss(
        kernels, color, opacity, targets, active, kind, learnt, huber, scale
    )
    behind = reference.background(kind, learnt, 4, 9, rays)
    own = slice(0, active)
    _, want = reference.losses(color, opacity, targets, behind, huber)
    # A few roundings of numbers up to 1, of which squares are taken; the slopes times the scale.
    np.testing.assert_allclose(errors[own], want[own], rtol=1e-5, atol=1e-6)
    assert (errors[active:] == 0).all()

    def total(c=color, o=opacity, b=behind):
        return scale * reference.losses(c, o, targets, b, huber)[0].sum()

    def compare(d, function, at):
        want = reference.slope(function, at)[own]
        np.testing.assert_allclose(d[own], want, rtol=1e-5, atol=scale * 1e-6)

    compare(d_color, lambda c: total(c=c), color)
    compare(d_opacity, lambda o: total(o=o), opacity)
    compare(d_learnt, lambda b: total(b=b), behind)
    for d in (d_color, d_opacity, d_learnt):
        assert (d[active:] == 77).all()


@pytest.mark.parametrize("huber", [0.0, 0.1])
def test_loss_of_what_diverged_is_no_number(kernels, huber):
    color, opacity, targets = seen(6)
    color[1, 2] = opacity[2] = np.nan
    kind, learnt = Background.WHITE, np.zeros(3, F32)
    for array in loss(kernels, color, opacity, targets, 6, kind, learnt, huber):
        broken = np.isnan(array.reshape(6, -1)).any(axis=1)
        np.testing.assert_array_equal(np.flatnonzero(broken), [1, 2])


def test_random_backgrounds_change_with_the_step(kernels):
    color, opacity, targets = seen(200)
    learnt = np.zeros(3, F32)
    first, again, second = (
        loss(kernels, color, opacity, targets, 200, Background.RANDOM, learnt, 0.0, step=step)[0]
        for step in (0, 0, 1)
    )
    np.testing.assert_array_equal(first, again)
    assert (first != second).mean() > 0.9


@pytest.mark.parametrize("active", [0, 1, 257, 1000])
@pytest.mark.parametrize("parts", [1, 7, 128])
def test_gather_the_gradient_of_a_background(kernels, parts, active):
    d_learnt = np.random.default_rng(6).normal(size=(1000, 3)).astype(F32)
    before = np.array([1.0, -2.0, 3.0], F32)
    _, after = kernels(
        "radiance.training.background.gather", d_learnt, np.array([active], I32),
        out=[((parts, 3), F32), before],
    )  # fmt: skip
    want = before + d_learnt[:active].sum(0, dtype=float)
    # So many additions at most, each off by 2^-24 of a sum below that of the sizes.
    size = np.abs(d_learnt[:active]).sum(dtype=float) + 3
    np.testing.assert_allclose(after, want, rtol=0, atol=2**-24 * (active + parts) * size)
