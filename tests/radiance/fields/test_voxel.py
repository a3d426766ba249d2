"""The primitives of the voxel field against NumPy in float64."""

from functools import cache

import numpy as np
import pytest

from cvkern.kernels.codes.radiance import AdamRule, Composited, Grid, Learnt, March, Rays, Space
from tests.radiance import reference_derived
from tests.radiance.fields import reference_voxel as reference

F32, I32, U8, U32 = np.float32, np.int32, np.uint8, np.uint32
ALL = -60.0  # a raw density that nothing is below


def rays(count, seed=0, inside=False):
    """Rays from a sphere (or from close to the middle) to points round the middle."""
    rng = np.random.default_rng(seed)
    origins = rng.normal(size=(count, 3))
    origins *= (0.3 if inside else 2.5) / np.linalg.norm(origins, axis=1, keepdims=True)
    directions = rng.uniform(-0.6, 0.6, (count, 3)) - origins
    if inside:
        directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return origins.astype(F32), directions.astype(F32)


def grid(resolution, basis, shift, scale=1.0, seed=0):
    rng = np.random.default_rng(seed)
    side = (resolution + 1,) * 3
    density = (scale * rng.normal(size=side) + shift).astype(F32)
    color = rng.normal(size=(*side, -(-3 * basis // 16) * 16)).astype(F32)
    color[..., 3 * basis :] = 0
    return density, color


def case(name):
    """Arguments of `render`: each case takes a way of its own through the kernels."""
    basis, resolution, cells, count = 9, 4, 4, 5
    shift, scale, stop, least, finest, cone = -0.5, 1.0, 1e-4, ALL, 0.11, 0.0
    unbounded, jittered, active, inside = False, False, count, False
    if name == "jittered":
        jittered = True
    elif name == "zero density":
        least = 60.0
    elif name == "thin samples are empty":
        shift, scale, least = -1.0, 3.0, -3.0
    elif name == "opaque first sample":
        shift, scale = 9.0, 0.1
    elif name == "nearly opaque first sample":
        shift, scale = 3.8, 0.1
    elif name == "underflowing transmittance":
        shift, scale, stop = 4.0, 0.5, -1.0
    elif name == "early stop":
        shift, stop = 1.5, 0.4
    elif name == "one sample":
        finest, count, active = 2.2, 5, 5
    elif name == "unbounded":
        unbounded, cone, inside = True, 0.1, True
    elif name == "degree 0":
        basis = 1
    elif name == "degree 1":
        basis = 4
    elif name == "blocks of cells":
        resolution, cells, shift, scale, least, finest = 16, 4, -2.0, 1.0, -1.0, 0.06
    elif name == "random cells are empty":
        resolution, finest, count, active = 16, 0.03, 8, 8
    elif name == "not all rays":
        active = 3
    density, color = grid(resolution, basis, shift, scale)
    if name == "blocks of cells":  # most of them empty
        density[:, 6:, :9] = -8
        density[9:] = -8
    origins, directions = rays(count, inside=inside)
    if name == "a ray that misses":
        directions[::2] *= -1
    if name == "along the axes":
        origins[:3] = -2.5 * np.eye(3) + 0.31 * (1 - np.eye(3))
        directions[:3] = np.eye(3)
        origins[3], directions[3] = (0.3, 0.2, 3), (0, 0, -1)
    far = 30.0 if unbounded else 4.0
    near, bits = 0.1, reference.mark(density, cells, least)
    if name == "random cells are empty":
        bits = np.random.default_rng(6).integers(0, 2**32, 16, U32, endpoint=False)
        cells = 8
    march = near, far, finest, cone, unbounded, jittered, 7, np.array([5], I32), stop, least
    return (
        *(origins, directions, np.array([active], I32), bits, cells),
        *(*march, basis, density, color),
    )


CASES = [
    "fog", "jittered", "zero density", "thin samples are empty", "opaque first sample",
    "nearly opaque first sample",
    "underflowing transmittance", "early stop", "one sample", "a ray that misses",
    "along the axes", "unbounded", "degree 0", "degree 1", "blocks of cells",
    "random cells are empty", "not all rays",
]  # fmt: skip


def outputs(count):
    seen = Composited(((count, 3), F32), ((count,), F32), ((count,), F32), ((count,), F32))
    return [seen, ((count,), I32)]


def packed(arguments):
    """Return the arguments of the primitives, from those of the reference."""
    origins, directions, active, bits, cells, near, far, finest, cone, *others = arguments
    unbounded, jittered, seed, step, stop, least, basis, density, color = others
    return (
        Rays(origins, directions, active),
        Space(bits, 1, cells, unbounded),
        March(near, far, finest, cone, 0, jittered, seed, step),
        Grid(density, color, basis, least),
        stop,
    )


def backward(kernels, gradients, arguments, seen, grids):
    """Return the gradients of what was seen, by the primitive."""
    return kernels(
        "radiance.fields.voxel.rays.render_backward",
        Composited(*gradients),
        *packed(arguments),
        Composited(*seen[:4]),
        seen[4],
        out=grids,
    )


@cache
def rendered(name):
    return reference.render(*case(name))


@pytest.mark.parametrize("name", CASES)
def test_render(kernels, name):
    arguments = case(name)
    active = int(arguments[2][0])
    got = kernels(
        "radiance.fields.voxel.rays.render", *packed(arguments), out=outputs(len(arguments[0]))
    )
    want = rendered(name)
    assert np.array_equal(got[4], want[4])
    # Distances are sums of up to 100 steps below 5: 100 * 2^-22 off, times slopes of up to 4 / cell
    # of the raw density and as much of the colours.
    for ours, theirs in zip(got[:4], want[:4], strict=True):
        np.testing.assert_allclose(ours[:active], theirs[:active], atol=5e-4, rtol=1e-4)
    if name == "zero density":
        assert not any(part.any() for part in got)
    if name == "opaque first sample":
        assert (want[4] == 1).all()
    if name == "underflowing transmittance":
        assert want[4].min() > 10
        assert want[1].min() > 1 - 1e-12
    if name == "one sample":
        assert want[4].max() == 1
    if name == "a ray that misses":
        assert (want[4][::2] == 0).all()
        assert (want[4][1::2] > 0).all()


def sensitivities(arguments, gradients, nodes, coefficients):
    """Central differences of the loss <gradients, rendered>, in float64."""
    *fixed, density, color = arguments
    density, color = density.astype(float), color.astype(float)

    def loss():
        every = [*fixed, density, color]
        found = reference.render(*every)
        return sum((a * g).sum() for a, g in zip(found[:4], gradients, strict=True))

    def slope(array, index, step=1e-4):
        before = array[index]
        array[index] = before + step
        above = loss()
        array[index] = before - step
        below = loss()
        array[index] = before
        return (above - below) / (2 * step)

    return [slope(density, n) for n in nodes], [slope(color, c) for c in coefficients]


@cache
def differences(name):
    """Gradients of a case, parameters, and how the loss depends on them."""
    arguments = case(name)
    rng = np.random.default_rng(4)
    count, active = len(arguments[0]), int(arguments[2][0])
    gradients = [rng.normal(size=s).astype(F32) for s in ((count, 3), count, count, count)]
    for g in gradients:
        g[active:] = 0
    density = arguments[-2]
    nodes = [tuple(n) for n in rng.integers(0, len(density), (18, 3))]
    coefficients = [(*n, int(rng.integers(3 * arguments[-3]))) for n in nodes]
    return (
        arguments,
        gradients,
        nodes,
        coefficients,
        *sensitivities(arguments, gradients, nodes, coefficients),
    )


@pytest.mark.parametrize("name", CASES)
def test_gradients_are_central_differences(kernels, name):
    arguments, gradients, nodes, coefficients, of_density, of_color = differences(name)
    density, color = arguments[-2:]
    seen = kernels(
        "radiance.fields.voxel.rays.render", *packed(arguments), out=outputs(len(arguments[0]))
    )
    grids = [np.zeros_like(density), np.zeros_like(color), np.zeros(density.shape, U8)]
    d_density, d_color, touched = backward(kernels, gradients, arguments, seen, grids)
    # What is left of the light behind an opaque sample is a difference of numbers near 1, and
    # the gradient multiplies that by the density: 9000 * 2^-24 at a step's optical depth.
    atol = 2e-3
    np.testing.assert_allclose([d_density[n] for n in nodes], of_density, atol=atol, rtol=2e-3)
    np.testing.assert_allclose([d_color[c] for c in coefficients], of_color, atol=5e-4, rtol=1e-3)
    assert not d_density[touched == 0].any()
    assert not d_color[touched == 0].any()
    assert touched.max() <= 1
    assert touched.any() == (seen[4].sum() > 0)
    if name == "fog":
        assert np.abs(of_density).max() > 0.05
        assert np.abs(of_color).max() > 0.01


@pytest.mark.parametrize("name", sorted(set(CASES) - {"zero density"}))
def test_gradients_are_what_warp_derives(kernels, name):
    """At every node, not some; what is sampled where is the reference's."""
    arguments, gradients, *_ = differences(name)
    density, color = arguments[-2:]
    seen = kernels(
        "radiance.fields.voxel.rays.render", *packed(arguments), out=outputs(len(arguments[0]))
    )
    grids = [np.zeros_like(density), np.zeros_like(color), np.zeros(density.shape, U8)]
    d_density, d_color, _ = backward(kernels, gradients, arguments, seen, grids)
    g = np.concatenate([gradients[0], np.stack(gradients[1:], 1)], 1)
    want_density, want_color = reference_derived.voxel_backward(g, *arguments)
    # Both are sums of up to 100 terms in float32, below 10 for densities, below 0.1 for colours:
    # 100 * 2^-24 off; but behind opaque samples, as above.
    opaque = name in ("opaque first sample", "underflowing transmittance")
    np.testing.assert_allclose(d_density, want_density, atol=2e-3 if opaque else 6e-5, rtol=1e-4)
    np.testing.assert_allclose(d_color, want_color, atol=1e-6, rtol=1e-4)


def test_gradients_are_added(kernels):
    arguments, gradients, *_ = differences("fog")
    seen = kernels(
        "radiance.fields.voxel.rays.render", *packed(arguments), out=outputs(len(arguments[0]))
    )
    density, color = arguments[-2:]
    results = []
    for start in (0, 3):
        untouched = np.zeros(density.shape, U8)
        grids = [np.full_like(density, start), np.full_like(color, start), untouched]
        results.append(backward(kernels, gradients, arguments, seen, grids))
    for alone, added in zip(results[0][:2], results[1][:2], strict=True):
        np.testing.assert_allclose(added, alone + 3, atol=1e-5)


def test_the_backward_pass_is_the_transpose_of_the_forward_pass(kernels):
    """<g, J v> = <J^T g, v> for 200 rays through 32^3 cells."""
    rng = np.random.default_rng(2)
    density, color = grid(32, 9, 0.0)
    origins, directions = rays(200)
    bits = np.full(16**3 // 32, 2**32 - 1, U32)
    arguments = (origins, directions, np.array([200], I32), bits, 16, 0.1, 10.0, 1 / 32, 0.0, False,
                 True, 1, np.array([2], I32), 1e-4, ALL, 9, density, color)  # fmt: skip
    gradients = [rng.normal(size=s).astype(F32) for s in ((200, 3), 200, 200, 200)]
    seen = kernels("radiance.fields.voxel.rays.render", *packed(arguments), out=outputs(200))
    grids = [np.zeros_like(density), np.zeros_like(color), np.zeros(density.shape, U8)]
    d_density, d_color, _ = backward(kernels, gradients, arguments, seen, grids)
    v_density, v_color = rng.normal(size=density.shape), rng.normal(size=color.shape)
    v_color[..., 27:] = 0
    losses = []
    for step in (1e-5, -1e-5):
        moved = [*arguments[:-2], density + step * v_density, color + step * v_color]
        moved = reference.render(*moved)
        losses.append(sum((a * g).sum() for a, g in zip(moved[:4], gradients, strict=True)))
    slope = (losses[0] - losses[1]) / 2e-5
    found = (d_density * v_density).sum() + (d_color * v_color).sum()
    size = np.sqrt((d_density**2).sum() + (d_color**2).sum())
    assert abs(slope) > 0.1 * size  # a sum of so many random numbers: not nearly 0
    assert abs(found - slope) < 1e-3 * size


def test_homogeneous_fog_has_the_closed_form(kernels):
    """Opacity 1 - e^(-sigma L), and half of the mean depth and distortion from its integrals."""
    density, color = grid(8, 1, 0.0, 0.0)
    color[...] = 0
    density[...] = np.log(0.7)
    origins, directions = np.array([[0.1, 0.2, -3]], F32), np.array([[0, 0, 1]], F32)
    bits = np.full(2, 2**32 - 1, U32)
    arguments = (origins, directions, np.array([1], I32), bits, 4, 0.1, 10.0, 1 / 256, 0.0, False,
                 False, 1, np.array([0], I32), 0.0, ALL, 1, density, color)  # fmt: skip
    colors, opacity, depth, distortion, samples = kernels(
        "radiance.fields.voxel.rays.render", *packed(arguments), out=outputs(1)
    )
    s, length = 0.7, 2.0
    through = np.exp(-s * length)
    assert samples[0] in (511, 512, 513)  # by rounding at the sides
    rtol = 0.7 / 256  # a sample more or less
    np.testing.assert_allclose(opacity, 1 - through, rtol=rtol)
    np.testing.assert_allclose(colors, 0.5 * (1 - through), rtol=rtol)
    mean = 2 * (1 - through) + (1 - through) / s - length * through
    np.testing.assert_allclose(depth, mean, rtol=rtol)
    # Twice the integral over b < a of w(a) w(b) (a - b), with w(t) = s e^(-s t).
    want = (1 - 2 * s * length * through - through**2) / s
    np.testing.assert_allclose(distortion, want, rtol=0.01)


def test_total_variation(kernels):
    density, color = grid(6, 4, 0.0)
    touched = (np.random.default_rng(3).random(density.shape) < 0.6).astype(U8)
    start = [np.ones_like(density), np.ones_like(color)]
    got = kernels(
        "radiance.fields.voxel.nodes.total_variation", 0.3, 0.2, touched, density, color, out=start
    )
    for found, values, weight in zip(got, (density, color), (0.3, 0.2), strict=True):
        want = reference.total_variation(values.astype(float), weight)
        want[touched == 0] = 0
        np.testing.assert_allclose(found, 1 + want, atol=1e-5)


def test_adam_moves_touched_nodes(kernels):
    density, color = grid(6, 9, 0.0)
    rng = np.random.default_rng(4)
    touched = (rng.random(density.shape) < 0.3).astype(U8)

    def like(values):
        gradient, mean = (rng.normal(size=values.shape).astype(F32) for _ in range(2))
        return [gradient, mean, rng.random(values.shape).astype(F32), values]

    before = [touched, Learnt(*like(density)), Learnt(*like(color))]
    rates = np.array([0.1, 0.9, 0.8], F32), np.array([0.02, 0.9, 0.8], F32)
    after = kernels(
        "radiance.fields.voxel.nodes.adam",
        *rates,
        np.array([0.5], F32),
        AdamRule(0.9, 0.99, 1e-8),
        out=before,
    )
    before = [touched, *before[1], *before[2]]
    assert not after[0].any()
    moved = touched == 1
    for k, rate in ((1, 0.1), (5, 0.02)):
        g, m, v, w = (a.astype(float) for a in before[k : k + 4])
        m, v = 0.9 * m + 0.1 * 0.5 * g, 0.99 * v + 0.01 * (0.5 * g) ** 2
        w = w - rate * (m / 0.9) / (np.sqrt(v / 0.8) + 1e-8)
        for found, start, want in zip(
            after[k : k + 4], before[k : k + 4], (0 * g, m, v, w), strict=True
        ):
            np.testing.assert_allclose(found[moved], want[moved], rtol=1e-5, atol=1e-6)
            assert np.array_equal(found[~moved], start[~moved])


@pytest.mark.parametrize(("resolution", "cells"), [(4, 4), (16, 8), (32, 8)])
def test_mark(kernels, resolution, cells):
    density, _ = grid(resolution, 1, -2.5)
    out = [((cells**3 // 32,), U32)]
    got = kernels("radiance.fields.voxel.nodes.mark", density, cells, 0.3, out=out)
    assert np.array_equal(got, reference.mark(density, cells, 0.3))


@pytest.mark.parametrize(("coarse", "fine"), [(4, 8), (4, 12), (8, 12), (6, 16)])
def test_upsampling_keeps_a_trilinear_function(kernels, coarse, fine):
    def values(n):
        z, y, x = np.meshgrid(*[np.linspace(0, 1, n + 1)] * 3, indexing="ij")
        return np.stack((1 + x - 2 * y + 3 * z, x * y * z, y * z - x), axis=-1).astype(F32)

    density = np.zeros((coarse + 1,) * 3, F32)
    out = [((*[fine + 1] * 3, 3), F32)]
    got = kernels("radiance.fields.voxel.nodes.upsample", density, -1.0, values(coarse), out=out)
    # Eight products of three shares and a value, each with errors of a few 2^-24.
    np.testing.assert_allclose(got, values(fine), atol=2e-6)
    density[1, 2, 3] = 1
    got = kernels("radiance.fields.voxel.nodes.upsample", density, 0.5, values(coarse), out=out)
    z, y, x = np.meshgrid(*[np.arange(fine + 1) * coarse / fine] * 3, indexing="ij")
    near = (abs(z - 1) <= 1) & (abs(y - 2) <= 1) & (abs(x - 3) <= 1)
    np.testing.assert_allclose(got[near], values(fine)[near], atol=2e-6)
    assert (got[~near] == 77).all()
