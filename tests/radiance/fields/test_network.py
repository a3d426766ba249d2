"""The perceptrons of a hash field as one primitive forward and one backward."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from cvkern.kernels.codes.radiance import NetworkInputs, network_layers, network_room
from tests.radiance import reference_radiance as reference

F16, F32, I32 = np.float16, np.float32, np.int32
RAYS, VIEWS = 40, 5
SIZES = [(300, 300), (300, 259), (700, 641), (70, 1), (70, 0)]  # room, samples


@dataclass
class Case:
    """Inputs with room for more samples than there are, and how to call the primitives."""

    kernels: Any
    half: Any
    samples: int
    total: int
    inputs: int
    lit: bool = False

    def __post_init__(self):
        rng = np.random.default_rng(self.total + self.inputs)
        self.features = rng.normal(size=(self.samples, self.inputs)).astype(self.half)
        directions = rng.normal(size=(RAYS, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        self.directions = directions.astype(F32)
        self.rays = rng.integers(0, RAYS, self.samples).astype(I32)
        shapes = network_layers(self.inputs, self.lit)
        layers = [rng.uniform(-1, 1, s) * np.sqrt(6 / sum(s)) for s in shapes]
        self.weights = np.concatenate([w.ravel() for w in layers]).astype(self.half)
        self.d_sigma = rng.normal(size=self.samples).astype(F32)
        self.d_rgb = rng.normal(size=(self.samples, 3)).astype(F32)
        self.table = rng.normal(size=(VIEWS, 16)).astype(F32) if self.lit else None
        self.views = rng.integers(0, VIEWS, RAYS).astype(I32) if self.lit else None

    @property
    def given(self):
        return NetworkInputs(
            self.features, self.directions, self.rays, self.number, self.weights, self.table,
            self.views,
        )  # fmt: skip

    @property
    def room(self):
        return network_room(self.inputs, self.samples, self.half == F16, self.lit), F32

    @property
    def number(self):
        return np.array([self.total], I32)

    def forward(self):
        """Return the working memory, density and colour."""
        return self.kernels(
            "radiance.fields.perceptron.network.forward",
            self.given,
            out=[self.room, ((self.samples,), F32), ((self.samples, 3), F32)],
        )

    def backward(self, before):
        """Return the gradients of features, of lights if lit and, added to `before`, weights."""
        memory, sigma, rgb = self.forward()
        _, *found = self.kernels(
            "radiance.fields.perceptron.network.backward",
            self.d_sigma,
            self.d_rgb,
            self.given,
            sigma,
            rgb,
            out=[
                memory,
                (self.features.shape, self.half),
                ((self.samples, 16), F32) if self.lit else None,
                before,
            ],
        )
        return found

    def exact(self):
        """Return the arguments of the reference, cut to the samples in use, in float64."""
        features = self.kernels(
            "radiance.encodings.spherical",
            self.directions,
            self.rays,
            np.array([self.samples], I32),
            0,
            out=[((self.samples, 16), F32)],
        )
        if self.table is not None and self.views is not None:
            features = np.concatenate([features, self.table[self.views[self.rays]]], 1)
        given = self.features, features, self.d_sigma, self.d_rgb
        features, views, d_sigma, d_rgb = (a[: self.total].astype(float) for a in given)
        return d_sigma, d_rgb, features, views, self.weights.astype(float)

    def kept(self, values):
        """Round what a layer gives."""
        return values.astype(self.half).astype(float)

    def close(self, got, want):
        """Compare with the reference.

        Sums in float32 are 1e-6 of their terms off. In half precision such a sum may round to
        another number than that of the reference, 2^-11 off, and so on in the next layer.
        """
        size = np.abs(want).max(initial=1e-3)
        assert np.abs(got - want).max(initial=0) <= (4e-3 if self.half == F16 else 2e-5) * size


@pytest.fixture(params=[(16, False), (32, False), (48, True), (64, False)])
def inputs(request):
    """Return the number of features, and whether there are lights."""
    return request.param


@pytest.mark.parametrize(("samples", "total"), SIZES)
def test_forward(kernels, half, inputs, samples, total):
    case = Case(kernels, half, samples, total, *inputs)
    _, sigma, rgb = case.forward()
    want = reference.network(*case.exact()[2:], case.kept)
    case.close(sigma[:total], want[0])
    case.close(rgb[:total], want[1])
    assert (sigma[total:] == 77).all()
    assert (rgb[total:] == 77).all()
    _, alone = kernels(
        "radiance.fields.perceptron.network.density", case.features, case.number, case.weights,
        out=[case.room, ((samples,), F32)],
    )  # fmt: skip
    np.testing.assert_array_equal(alone, sigma)


@pytest.mark.parametrize(("samples", "total"), SIZES)
def test_backward(kernels, half, inputs, samples, total):
    case = Case(kernels, half, samples, total, *inputs)
    before = np.random.default_rng(1).normal(size=case.weights.shape).astype(F32)
    d_features, *d_lights, d_weights = case.backward(before)
    want = reference.network_backward(*case.exact(), case.kept)
    case.close(d_features[:total], want[0])
    assert (d_features[total:] == 77).all()
    for found in d_lights:
        case.close(found[:total], want[2])
        assert (found[total:] == 77).all()
    layers = [reference.network_parts(d, inputs[0]) for d in (d_weights - before, want[1])]
    for got, wanted in zip(*layers, strict=True):
        case.close(got, wanted)


def gates(features, views, weights):
    """Return the inputs of the rectifiers."""
    a, b, c, d, _ = reference.network_parts(weights, features.shape[1])
    first = features @ a
    second = np.concatenate([np.maximum(first, 0) @ b, views], 1) @ c
    return np.concatenate([first, second, np.maximum(second, 0) @ d], 1)


def test_backward_is_the_slope(kernels, half):
    """Along a random direction of the features, lights and each layer, in float64.

    Samples with a rectifier near 0 have no part in the loss: half precision may open or close it.
    """
    case = Case(kernels, half, 2000, 2000, 32, lit=True)
    clear = np.all(np.abs(gates(*case.exact()[2:])) > 2**-7, axis=1)
    assert clear.sum() > 100
    case.d_sigma *= clear
    case.d_rgb *= clear[:, None]
    d_features, d_lights, d_weights = case.backward(np.zeros(case.weights.shape, F32))
    d_sigma, d_rgb, features, sides, weights = case.exact()

    def loss(features, weights, views=sides):
        sigma, rgb, _ = reference.network(features, views, weights)
        return (d_sigma * sigma).sum() + (d_rgb * rgb).sum()

    rng, e = np.random.default_rng(9), 1e-8  # so short that it passes no gate
    way = rng.normal(size=features.shape)
    slope = (loss(features + e * way, weights) - loss(features - e * way, weights)) / (2 * e)
    # Errors of roundings add up like a random walk. In half precision they have a standard
    # deviation of 2^-11 / sqrt(3), and ten follow each other; allow three deviations.
    tolerance = 3 * np.sqrt(10 / 3) * 2**-11 if half == F16 else 1e-5
    assert abs((d_features * way).sum() - slope) < tolerance * np.linalg.norm(d_features)
    way = np.pad(rng.normal(size=d_lights.shape), ((0, 0), (16, 0)))
    ends = [loss(features, weights, sides + step * way) for step in (e, -e)]
    slope = (ends[0] - ends[1]) / (2 * e)
    assert abs((d_lights * way[:, 16:]).sum() - slope) < tolerance * np.linalg.norm(d_lights)
    for k in range(5):
        way = [np.zeros(s) for s in network_layers(32, lit=True)]
        way[k] = rng.normal(size=way[k].shape)
        way = np.concatenate([w.ravel() for w in way])
        slope = (loss(features, weights + e * way) - loss(features, weights - e * way)) / (2 * e)
        size = np.linalg.norm(d_weights[way != 0])
        assert abs((d_weights * way).sum() - slope) < tolerance * size


def test_backward_is_the_same_every_time(kernels, half):
    case = Case(kernels, half, 3000, 2900, 32)
    first, again = (case.backward(np.zeros(case.weights.shape, F32)) for _ in range(2))
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a, b)


def test_large_densities_are_cut_off_and_their_gradients_are_not(kernels, half):
    case = Case(kernels, half, 100, 100, 32)
    case.features *= 50
    case.d_sigma[:] = np.sign(case.d_sigma) * 1e-4
    case.d_rgb[:] = 0
    _, sigma, _ = case.forward()
    most = sigma > 59874
    assert most.sum() > 10
    np.testing.assert_allclose(sigma[most], np.exp(11), rtol=2e-6)  # CUDA's exp: 2 ulp
    d_features, _ = case.backward(np.zeros(case.weights.shape, F32))
    want, *_ = reference.network_backward(*case.exact(), case.kept)
    assert (np.abs(want[most]).max(1) > 0.1).all()
    case.close(d_features[most], want[most])


@pytest.mark.parametrize("given", ["d_sigma", "d_rgb"])
def test_gradients_of_what_diverged_are_no_numbers(kernels, half, given):
    case = Case(kernels, half, 100, 100, 32)
    getattr(case, given)[70] = np.nan
    d_features, d_weights = case.backward(np.zeros(case.weights.shape, F32))
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(d_features).any(axis=1)), [70])
    assert np.isnan(d_weights).any()


def test_gradients_stay_within_half_precision(kernels, half):
    case = Case(kernels, half, 100, 100, 32)
    case.d_sigma[:] = 1e30
    case.d_rgb[:] = 0
    d_features, d_weights = case.backward(np.zeros(case.weights.shape, F32))
    assert np.isfinite(d_features).all()
    assert np.isfinite(d_weights).all()
    want = reference.network_backward(*case.exact(), case.kept)
    if half == F32:  # in halves products of 30000 are cut off in turn
        case.close(d_features, want[0])
