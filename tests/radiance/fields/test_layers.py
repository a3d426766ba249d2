"""The parts of hash fields: encodings, layers of perceptrons, their last activations."""

from typing import Any

import numpy as np
import pytest
import scipy.special

from tests.radiance import reference_radiance as reference

F16, F32, I32 = np.float16, np.float32, np.int32


def noise(*shape, dtype: Any = F32, seed=0):
    return np.random.default_rng(seed).normal(size=shape).astype(dtype)


def number(value):
    return np.array([value], I32)


# ------------------------------------------------------------------------------------- encodings


def test_spherical_harmonics_are_those_of_scipy(kernels):
    if not hasattr(scipy.special, "sph_harm_y"):
        pytest.skip("needs scipy 1.15")
    directions = noise(200, 3)
    directions[:6] = np.vstack([np.eye(3), -np.eye(3)])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    samples, total, column = 500, 450, 3
    rays = np.random.default_rng(1).integers(0, 200, samples).astype(I32)
    rays[:200] = np.arange(200)
    features = kernels(
        "radiance.encodings.spherical", directions, rays, number(total), column,
        out=[((samples, 24), F32)],
    )  # fmt: skip
    x, y, z = directions.T.astype(float)
    polar, azimuth = np.arctan2(np.hypot(x, y), z), np.arctan2(y, x)
    own = rays[:total]
    for degree in range(4):
        for order in range(-degree, degree + 1):
            value = scipy.special.sph_harm_y(degree, abs(order), polar, azimuth)
            want = np.sqrt(2) * (value.imag if order < 0 else value.real) if order else value.real
            got = features[:total, column + degree * (degree + 1) + order]
            # Polynomials of degree 3 in numbers up to 1, with coefficients up to 5.
            np.testing.assert_allclose(got, want[own], rtol=0, atol=2e-6)
    features[:total, column : column + 16] = 77
    assert (features == 77).all()


GRIDS = {
    # resolutions, entries of each level: some hold every corner, some are hashed
    "one": ([4], [128]),
    "dense": ([1, 3, 7], [8, 64, 512]),
    "hashed": ([5, 16, 100, 2048], [216, 1024, 1024, 256]),
}


@pytest.fixture(params=GRIDS)
def grids(request):
    resolutions, sizes = GRIDS[request.param]
    return np.array(resolutions, I32), np.concatenate([[0], np.cumsum(sizes)]).astype(I32)


def places(count, seed=2):
    """Return points of the unit cube, its corners and the sides of cells among them."""
    positions = np.random.default_rng(seed).random((count, 3))
    positions[:8] = np.indices((2, 2, 2)).reshape(3, 8).T
    positions[8:40] = np.round(positions[8:40] * 4) / 4
    return positions.astype(F32)


def encode(kernels, positions, total, grids, table, dtype: Any = F32):
    shape = len(positions), 2 * len(grids[0])
    return kernels(
        "radiance.fields.hash.encode",
        positions,
        number(total),
        *grids,
        table.astype(dtype),
        out=[(shape, dtype)],
    )


def test_hash_encode(kernels, grids):
    positions, table = places(300), noise(grids[1][-1], 2)
    features = encode(kernels, positions, 250, grids, table)
    # A GPU may round the product whose cell is taken away from it, or not: of 100 cells that moves
    # a place by 4e-6. Then eight products of numbers up to 4 are summed.
    off = [
        np.abs(features[:250] - reference.hash_encode(positions[:250], grids, table, fused))
        for fused in (False, True)
    ]
    assert (off[0] if kernels.device == "cpu" else np.minimum(*off)).max() <= 3e-6
    assert (features[250:] == 77).all()


def test_hash_encode_in_half_precision(kernels, half, grids):
    if half == F32:
        pytest.skip("needs a GPU")
    positions, table = places(300), noise(grids[1][-1], 2, dtype=F16)
    features = encode(kernels, positions, 300, grids, table, half)
    want = reference.hash_encode(positions, grids, table)
    np.testing.assert_allclose(features, want, rtol=2**-10, atol=1e-5)  # rounded once


def test_hash_encode_is_linear_between_corners(kernels):
    """Tables that hold a plane at the corners of a level give the plane."""
    n = 5
    grids = np.array([n], I32), np.array([0, (n + 1) ** 3], I32)
    k, j, i = np.indices((n + 1, n + 1, n + 1)).reshape(3, -1) / n
    table = np.stack([1 + 2 * i - 3 * j + 0.5 * k, i - k], 1)
    positions = places(100)
    x, y, z = positions.T
    want = np.stack([1 + 2 * x - 3 * y + 0.5 * z, x - z], 1)
    np.testing.assert_allclose(
        encode(kernels, positions, 100, grids, table), want, rtol=0, atol=3e-6
    )


def test_hash_backward(kernels, grids):
    positions, before = places(2000), noise(grids[1][-1], 2, seed=3)
    d_features = noise(2000, 2 * len(grids[0]), seed=4)
    d_features[100:200] = 0
    d_features[200:300, ::2], d_features[300:400, 1::2] = 0, 0  # one of the two of an entry
    given = positions, number(1900), *grids, d_features
    got = kernels("radiance.fields.hash.backward", *given, out=[before])
    want = reference.hash_backward(positions[:1900], grids, d_features[:1900])
    size = reference.hash_backward(positions[:1900], grids, np.abs(d_features[:1900]))
    # Sums of up to some 1000 terms, in float32.
    assert (np.abs(got - before - want) <= 1e-5 * (1 + size)).all()
    if kernels.device == "cpu":
        np.testing.assert_array_equal(
            kernels("radiance.fields.hash.backward", *given, out=[before]), got
        )


def test_hash_backward_is_the_transpose(kernels, grids):
    """<d_features, encode(table)> = <backward(d_features), table>: the encoding is linear."""
    positions, table = places(5000), noise(grids[1][-1], 2)
    d_features = noise(5000, 2 * len(grids[0]), seed=4)
    features = encode(kernels, positions, 5000, grids, table)
    d_table = kernels("radiance.fields.hash.backward", positions, number(5000), *grids, d_features,
                      out=[np.zeros_like(table)])  # fmt: skip
    got = (d_table.astype(float) * table).sum()
    want = (features.astype(float) * d_features).sum()
    assert abs(got - want) < 1e-6 * np.abs(d_table * table).sum()


# ---------------------------------------------------------------------------------------- layers

SIZES = [(16, 16), (32, 64), (64, 16), (64, 64), (128, 192), (320, 80), (288, 128)]


def close(got, want, size, dtype):
    """Compare sums of terms whose sizes sum up to `size`: rounded in float32, then to `dtype`."""
    assert got.dtype == dtype
    error = 2**-20 * size + (2**-10 * np.abs(want) + 1e-4 if dtype == F16 else 1e-6)
    assert (np.abs(got - want) <= error).all()


@pytest.mark.parametrize("relu", [False, True])
@pytest.mark.parametrize(("depth", "columns"), SIZES)
def test_dense_forward(kernels, half, depth, columns, relu):
    rows, total, column = 150, 131, 16
    x, w = noise(rows, depth + 16, dtype=half), noise(depth, columns, dtype=half, seed=1)
    y = kernels("radiance.fields.perceptron.layers.forward", x, w, number(total), relu, column,
                out=[((rows, columns + 32), half)])  # fmt: skip
    a, b = x[:total, :depth].astype(float), w.astype(float)
    want = np.maximum(a @ b, 0) if relu else a @ b
    own = slice(column, column + columns)
    close(y[:total, own], want, np.abs(a) @ np.abs(b), half)
    y[:total, own] = 77
    assert (y == 77).all()


@pytest.mark.parametrize("gated", [False, True])
@pytest.mark.parametrize(("depth", "columns"), SIZES)
def test_dense_backward_input(kernels, half, depth, columns, gated):
    rows, total, column = 150, 131, 16
    dy, w = noise(rows, columns + 32, dtype=half), noise(depth, columns, dtype=half, seed=1)
    x = np.maximum(noise(rows, depth, dtype=half, seed=2), 0)  # a rectifier gives this
    dx = kernels(
        "radiance.fields.perceptron.layers.backward_input",
        dy,
        w,
        x,
        number(total),
        gated,
        column,
        out=[((rows, depth), half)],
    )
    a, b = dy[:total, column : column + columns].astype(float), w.astype(float)
    mask = x[:total] > 0 if gated else 1
    close(dx[:total], mask * (a @ b.T), np.abs(a) @ np.abs(b.T), half)
    assert (dx[total:] == 77).all()


@pytest.mark.parametrize("total", [0, 1, 131, 3000])
@pytest.mark.parametrize(("depth", "columns"), SIZES)
def test_dense_backward_weight(kernels, half, depth, columns, total):
    rows, column = 3000, 16
    dy, x = noise(rows, columns + 32, dtype=half), noise(rows, depth + 16, dtype=half, seed=1)
    before = noise(depth, columns, seed=2)
    given = dy, x, number(total), column
    dw = kernels("radiance.fields.perceptron.layers.backward_weight", *given, out=[before])
    a, b = x[:total, :depth].astype(float), dy[:total, column : column + columns].astype(float)
    close(dw, before + a.T @ b, np.abs(before) + np.abs(a).T @ np.abs(b), F32)
    again = kernels("radiance.fields.perceptron.layers.backward_weight", *given, out=[before])
    np.testing.assert_array_equal(again, dw)


def perceptron(kernels, half, x, first, second, total):
    """Return the output of two layers, and their input in between."""
    shape = (len(x), first.shape[1]), half
    hidden = kernels(
        "radiance.fields.perceptron.layers.forward", x, first, total, True, 0, out=[shape]
    )
    shape = (len(x), second.shape[1]), half
    return kernels(
        "radiance.fields.perceptron.layers.forward", hidden, second, total, False, 0, out=[shape]
    ), hidden


def test_two_layers_backward_are_the_slope(kernels, half):
    """Along a random direction, in float64, of all weights and inputs together."""
    rows = 500
    x, total = noise(rows, 32, dtype=half), number(rows)
    first, second = (noise(*s, dtype=half, seed=s[1]) / 8 for s in ((32, 64), (64, 16)))
    dy = noise(rows, 16, dtype=half, seed=5)
    _, hidden = perceptron(kernels, half, x, first, second, total)
    d_hidden = kernels(
        "radiance.fields.perceptron.layers.backward_input",
        dy,
        second,
        hidden,
        total,
        True,
        0,
        out=[(hidden.shape, half)],
    )
    dx = kernels(
        "radiance.fields.perceptron.layers.backward_input",
        d_hidden,
        first,
        x,
        total,
        False,
        0,
        out=[(x.shape, half)],
    )
    zeros = [np.zeros(w.shape, F32) for w in (first, second)]
    d_first = kernels(
        "radiance.fields.perceptron.layers.backward_weight", d_hidden, x, total, 0, out=zeros[:1]
    )
    d_second = kernels(
        "radiance.fields.perceptron.layers.backward_weight", dy, hidden, total, 0, out=zeros[1:]
    )

    def loss(a, b, c):
        return (np.maximum(a @ b, 0) @ c * dy).sum(dtype=float)

    at = [a.astype(float) for a in (x, first, second)]
    steps = [noise(*a.shape, dtype=float, seed=9) for a in at]
    e = 1e-7
    ahead, behind = (loss(*(a + s * v for a, v in zip(at, steps, strict=True))) for s in (e, -e))
    found = [(g * v).sum(dtype=float) for g, v in zip((dx, d_first, d_second), steps, strict=True)]
    size = np.sqrt(sum((g.astype(float) ** 2).sum() for g in (dx, d_first, d_second)))
    # Errors of roundings add up like a random walk. In half precision they have a standard
    # deviation of 2^-11 / sqrt(3), and three follow each other; allow three deviations. Gates are
    # those of float32: the first layer's input is not rounded.
    tolerance = 1e-5 if half == F32 else 3 * 2**-11
    assert abs(sum(found) - (ahead - behind) / (2 * e)) < tolerance * size


# ----------------------------------------------------------------------------------------- heads


def test_heads(kernels, half):
    samples, total = 300, 280
    hidden, raw = 4 * noise(samples, 32, dtype=half), 4 * noise(samples, 16, dtype=half, seed=1)
    hidden[:3, 0], raw[:2, 0] = [20, -100, 11.5], [100, -100]
    sigma, rgb = kernels("radiance.fields.perceptron.heads.forward", hidden, raw, number(total),
                         out=[((samples,), F32), ((samples, 3), F32)])  # fmt: skip
    want = np.exp(np.minimum(hidden[:total, 0].astype(float), 11))
    # An error of 2^-24 of the exponent, and a few units of the last place of exp.
    np.testing.assert_allclose(sigma[:total], want, rtol=2e-6, atol=1e-37)  # or denormal, or 0
    want = scipy.special.expit(raw[:total, :3].astype(float))
    np.testing.assert_allclose(rgb[:total], want, rtol=0, atol=1e-6)
    assert (sigma[total:] == 77).all()
    assert (rgb[total:] == 77).all()


def test_heads_backward_are_the_slopes(kernels, half):
    samples, total = 60, 50
    hidden, raw = noise(samples, seed=1), noise(samples, 3, seed=2)
    sigma, rgb = np.exp(hidden), scipy.special.expit(raw)
    d_sigma, d_rgb = noise(samples, seed=3), noise(samples, 3, seed=4)
    d_raw = kernels("radiance.fields.perceptron.heads.color_backward", d_rgb, rgb, number(total),
                    out=[((samples, 16), half)])  # fmt: skip
    rtol, atol = (2**-10, 1e-3) if half == F16 else (1e-5, 1e-6)
    want = reference.slope(lambda r: (scipy.special.expit(r) * d_rgb).sum(dtype=float), raw)
    np.testing.assert_allclose(d_raw[:total, :3], want[:total], rtol=rtol, atol=atol)
    assert (d_raw[:total, 3:] == 0).all()
    assert (d_raw[total:] == 77).all()

    before = noise(samples, 32, seed=5, dtype=half)
    after = kernels(
        "radiance.fields.perceptron.heads.density_backward",
        d_sigma,
        sigma,
        number(total),
        out=[before],
    )
    want = before[:, 0] + reference.slope(lambda h: (np.exp(h) * d_sigma).sum(dtype=float), hidden)
    np.testing.assert_allclose(after[:total, 0], want[:total], rtol=rtol, atol=atol)
    after[:total, 0] = before[:total, 0]
    np.testing.assert_array_equal(after, before)


def test_density_backward_stays_within_half_precision(kernels, half):
    sigma, d_sigma = np.full(3, 6e4, F32), np.array([1e3, -1e3, np.nan], F32)
    after = kernels("radiance.fields.perceptron.heads.density_backward", d_sigma, sigma, number(3),
                    out=[np.zeros((3, 16), half)])  # fmt: skip
    np.testing.assert_array_equal(after[:, 0], np.array([30000, -30000, np.nan], half))
