"""The original radiance field as a whole: values, slopes, training, files."""

import sys
from dataclasses import asdict, replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import cvkern
from cvkern._runtime import KERNEL_SETS, runtime
from cvkern.app import cli
from cvkern.radiance import MLPField, evaluate, fit, load_model, make_scene, render, training
from cvkern.radiance.fields.field import Frame, Rays
from cvkern.radiance.fields.perceptron import MLPNetwork
from cvkern.radiance.scenes.photographs import Bounds
from tests.radiance.fields import reference_perceptron as reference
from tests.radiance.reference_radiance import slope
from tests.radiance.runs import interrupt, press_ctrl_c, same

F32, I32 = np.float32, np.int32
SMALL = MLPField(width=16, layers=3, skip=2, frequencies=2, view_frequencies=1, samples=64, rays=8,
                 cells=16, steps=64)  # fmt: skip
REAL = MLPField(width=64, layers=4, skip=2, samples=3000, rays=40, cells=16)
TINY = MLPField(
    width=64, layers=4, skip=2, frequencies=5, samples=2**11, rays=2**9, cells=16, steps=64,
    learning_rate=5e-3,
)  # fmt: skip


@pytest.fixture(params=KERNEL_SETS)
def anywhere(request, device):
    """Run the test once per kernel set and device."""
    try:
        chosen = cvkern.use(backend=request.param, device=device)
    except ValueError as absent:
        pytest.skip(str(absent))
    with chosen:
        yield runtime(np.empty(0))


class Trial:
    """A field with random samples along random rays, and the same in float64."""

    def __init__(self, settings, seed=0):
        self.rt, self.settings = runtime(np.empty(0)), settings
        rng, s = np.random.default_rng(seed), settings
        bounds = Bounds((0.0, 0.0, 0.0), 1.0, False)
        self.network = MLPNetwork(self.rt, Frame(bounds, 0.5, 4.0), seed, settings)
        self.total = s.samples - 7
        self.positions = rng.random((s.samples, 3)).astype(F32)
        self.directions = rng.normal(size=(s.rays, 3)).astype(F32)
        self.directions /= np.linalg.norm(self.directions, axis=1, keepdims=True)
        self.numbers = rng.integers(0, s.rays, s.samples).astype(I32)
        samples = self.network.samples
        self.rt.write(samples.positions, self.positions)
        self.rt.write(samples.rays, self.numbers)
        self.rt.write(samples.total, np.array([self.total], I32))
        self.d_sigma = rng.normal(size=s.samples).astype(F32)
        self.d_rgb = rng.normal(size=(s.samples, 3)).astype(F32)
        origins, directions = self.keep(0 * self.directions), self.keep(self.directions)
        self.rays = Rays(origins, directions, self.keep(np.array([s.rays], I32)))
        self.shapes = reference.shapes(s.width, s.layers, s.skip, s.frequencies, s.view_frequencies)
        used = self.rt.to_numpy(self.network.parameters.copy)
        self.half = used.dtype == np.float16
        self.weights = used.astype(float)

    def keep(self, values):
        array = self.rt.zeros(values.shape, values.dtype)
        self.rt.write(array, values)
        return array

    def forward(self):
        self.network.evaluate(self.rays.directions, self.network.samples)
        return [
            self.rt.to_numpy(a)[: self.total].copy()
            for a in (self.network.samples.sigma, self.network.samples.rgb)
        ]

    def backward(self):
        """Return the gradients of the weights."""
        self.forward()
        scale = F32(self.network.gradient_scale)
        self.rt.write(self.network.d_sigma, scale * self.d_sigma)
        self.rt.write(self.network.d_rgb, scale * self.d_rgb)
        self.network.evaluate_backward()
        return self.rt.to_numpy(self.network.parameters.gradients) / scale

    def reference(self, weights):
        s, own = self.settings, slice(self.total)
        return reference.field(
            self.positions[own], self.directions[self.numbers[own]],
            reference.split(weights, self.shapes), s.skip, s.frequencies, s.view_frequencies,
        )  # fmt: skip

    def loss(self, weights):
        sigma, rgb = self.reference(weights)
        return (sigma * self.d_sigma[: self.total]).sum() + (rgb * self.d_rgb[: self.total]).sum()


SHAPES: dict[str, Any] = {
    "small": SMALL,
    "no skip": replace(SMALL, skip=0),
    "skip after the first": replace(SMALL, skip=1),
    "one layer": replace(SMALL, layers=1, skip=0),
    "odd": replace(SMALL, width=48, frequencies=4, view_frequencies=2),
    "real": REAL,
}


@pytest.mark.parametrize("name", SHAPES)
def test_the_field_is_that_of_the_paper(anywhere, name):
    trial = Trial(SHAPES[name])
    assert trial.weights.size == sum(a * b for a, b in trial.shapes)
    (sigma, rgb), (want_sigma, want_rgb) = trial.forward(), trial.reference(trial.weights)
    # Sums of up to 128 products in each of at most seven layers, in float32; in half precision
    # what passes from one to the next has 11 digits.
    error = 0.02 if trial.half else 3e-5
    np.testing.assert_allclose(sigma, want_sigma, rtol=error, atol=error)
    np.testing.assert_allclose(rgb, want_rgb, rtol=0, atol=error)
    trial.network.evaluate_density(trial.network.samples.total)
    again = trial.rt.to_numpy(trial.network.samples.sigma)[: trial.total]
    np.testing.assert_array_equal(again, sigma)


@cache
def slopes(name, half):
    """How the loss depends on each weight; those that kernels use are the same in one precision."""
    trial = Trial(SHAPES[name])
    assert trial.half == half
    return slope(trial.loss, trial.weights, 1e-6)


@pytest.mark.parametrize("name", [name for name in SHAPES if name != "real"])
def test_gradients_are_slopes(anywhere, name):
    """Of every weight by itself."""
    trial = Trial(SHAPES[name])
    found, want = trial.backward(), slopes(name, trial.half)
    off = np.abs(found - want).max() / np.abs(want).max()
    # See above; a rectifier that opens in one precision only is a jump of its sample's share.
    assert off < (0.05 if trial.half else 1e-4)
    assert (want != 0).mean() > 0.5


def test_gradients_of_a_batch_are_slopes(anywhere):
    """Along the gradient, where the slope is steepest, and a random direction besides."""
    trial = Trial(REAL)
    found = trial.backward().astype(float)
    unit = found / np.linalg.norm(found)
    across = np.random.default_rng(1).normal(size=unit.shape)
    across /= np.linalg.norm(across)
    step = 1e-5
    for direction in (unit, unit + across):
        ahead, behind = (trial.loss(trial.weights + e * direction) for e in (step, -step))
        want = (ahead - behind) / (2 * step)
        assert abs((found * direction).sum() - want) < (0.02 if trial.half else 1e-4) * abs(want)


def test_gradients_are_equal_from_run_to_run(anywhere):
    first, second = (Trial(REAL).backward() for _ in range(2))
    np.testing.assert_array_equal(first, second)


# --------------------------------------------------------------------------------------- training


@pytest.fixture(scope="module")
def scene():
    return make_scene(train=16, test=2, size=24)


def test_a_tiny_scene_is_learnt(anywhere, scene):
    model = fit(scene, TINY, steps=100, seed=1)
    assert evaluate(model, scene).psnr.mean() > 18  # an empty picture has about 11


def test_unbounded_space(backend, scene):
    wide = replace(scene, bounds=scene.bounds._replace(unbounded=True))
    model = fit(wide, TINY, steps=60)
    assert evaluate(model, wide).psnr.mean() > 14


def test_an_interrupted_training_goes_on_to_the_same_model(backend, scene, tmp_path, monkeypatch):
    file = tmp_path / "model.npz"
    straight = fit(scene, TINY, steps=24)
    with monkeypatch.context() as patch:
        interrupt(patch, 13, press_ctrl_c)
        stopped = fit(scene, TINY, steps=24, checkpoint=file)
    assert (stopped.training.stopped, stopped.training.step) == (True, 13)
    assert not same(stopped, straight)
    assert same(fit(scene, TINY, steps=24, checkpoint=file, resume=True), straight)


def test_saved_models_render_the_same(scene, tmp_path):
    model = fit(scene, TINY, steps=20)
    model.save(tmp_path / "whole.npz")
    model.save(tmp_path / "small.npz", resumable=False)
    want = render(model, scene.cameras, 3)
    for name in ("whole", "small"):
        read = load_model(tmp_path / f"{name}.npz")
        assert read.settings == TINY
        # Half precision rounds weights by a share of 2^-12, of which sums and samples keep a part.
        error = 5e-4 if name == "small" else 0
        for a, b in zip(render(read, scene.cameras, 3), want, strict=True):
            np.testing.assert_allclose(a, b, rtol=error, atol=error)
    with cvkern.use(backend="taichi"):
        other = render(load_model(tmp_path / "small.npz"), scene.cameras, 3)
    # Sums of up to 128 products in float32, in another order, then some 64 samples a ray.
    np.testing.assert_allclose(other.color, want.color, atol=1e-4 + 5e-4)


@pytest.mark.parametrize("unbounded", [False, True])
def test_densities_are_those_of_the_network(backend, unbounded):
    rt, s = runtime(), TINY
    network = s.build(rt, Frame(Bounds((0, 0, 0), 1.0, unbounded), 0.1, 10.0), 0)
    points = np.random.default_rng(0).uniform(-1, 1, (3000, 3))  # more than a batch holds
    places = points
    if unbounded:
        points = points * 4
        away = np.linalg.norm(points, axis=1, keepdims=True)
        # Space beyond the unit ball is contracted into the ball of twice the radius.
        places = np.where(away > 1, points / away * (2 - 1 / away), points) / 2
    weights = reference.split(
        rt.to_numpy(network.parameters.values).astype(float),
        reference.shapes(s.width, s.layers, s.skip, s.frequencies, s.view_frequencies),
    )
    want, _ = reference.field(
        places / 2 + 0.5, 0 * points, weights, s.skip, s.frequencies, s.view_frequencies
    )
    # The place is rounded to float32, and one part in 2^24 of it is 2^4 pi times as much there.
    np.testing.assert_allclose(network.densities(points), want, rtol=1e-4)


def test_the_command_trains_it(scene, tmp_path, monkeypatch):
    monkeypatch.setitem(training.ON_CPU, "mlp", asdict(TINY))
    words = ["train", "shapes", "-o", tmp_path / "m.npz", "--field", "mlp", "--steps", "2"]
    monkeypatch.setattr(sys, "argv", ["cvkern", "nerf", *map(str, words), "--shrink", "4"])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    assert not stop.value.code
    assert load_model(tmp_path / "m.npz").settings == TINY


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"width": 40}, ValueError, "width must be a multiple of 16, got 40"),
        ({"width": 272}, ValueError, r"width must be in \[16, 256\], got 272"),
        ({"width": 64.0}, TypeError, "width must be an integer, got 64.0"),
        ({"layers": 0}, ValueError, r"layers must be in \[1, 64\], got 0"),
        ({"skip": 8}, ValueError, r"skip must be in \[0, 7\], got 8"),
        ({"frequencies": 15}, ValueError, r"frequencies must be in \[1, 14\], got 15"),
        ({"view_frequencies": 0}, ValueError, r"view_frequencies must be in \[1, 14\], got 0"),
        ({"steps": 1025}, ValueError, r"steps must be in \[1, 1024\], got 1025"),
    ],
)
def test_settings_out_of_range(changes, error, message):
    with pytest.raises(error, match=message):
        MLPField(**changes)
