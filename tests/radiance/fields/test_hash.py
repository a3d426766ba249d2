"""The hash field as a whole: its gradients are derivatives, equal in both sets and every run."""

from typing import Any

import numpy as np
import pytest

import cvkern
from cvkern._runtime import runtime
from cvkern.radiance import cameras, march
from cvkern.radiance.fields.field import Composited, Frame, Rays, View
from cvkern.radiance.fields.hash import HashField
from cvkern.radiance.scenes.photographs import Bounds, Scene

F32, I32 = np.float32, np.int32
SETTINGS = HashField(
    levels=8, table_bits=10, coarsest=4, finest=64, samples=8192, rays=64, cells=16
)
RAYS = 50  # there is room for 64


class Trial:
    """A field with strong features, which looks along some rays."""

    def __init__(self, *, unbounded=False, seed=0):
        self.rt = rt = runtime(np.empty(0))
        rng = np.random.default_rng(seed)
        frame = Frame(Bounds((0.0, 0.0, 0.0), 1.0, unbounded), 0.5, 30.0 if unbounded else 4.0)
        self.field = SETTINGS.build(rt, frame, seed=3)
        state = self.field.state()
        state["table.values"] = rng.uniform(-0.5, 0.5, state["table.values"].shape).astype(F32)
        bits = rng.random(state["occupancy.bits"].size * 32) < 0.5
        state["occupancy.bits"] = np.packbits(bits, bitorder="little").view(np.uint32)
        self.start = state
        towards = rng.uniform(-0.7, 0.7, (64, 3))
        origins = rng.normal(size=(64, 3))
        origins *= 2 / np.linalg.norm(origins, axis=1, keepdims=True)
        directions = towards - origins
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        self.rays = Rays(self.keep(origins), self.keep(directions), self.keep(RAYS, I32))
        self.gradients = [rng.normal(size=s).astype(F32) for s in ((64, 3), 64, 64, 64)]

    def keep(self, values, dtype: Any = F32):
        values = np.atleast_1d(np.asarray(values, dtype))
        array = self.rt.zeros(values.shape, dtype)
        self.rt.write(array, values)
        return array

    def look(self, **changes):
        """Render with some arrays of the state exchanged."""
        self.field.restore(self.start | changes)
        found = self.field.forward(self.rays, self.keep(1, I32))
        return [self.rt.to_numpy(a)[:RAYS].copy() for a in found]

    def see(self):
        """Render as pictures are."""
        self.field.restore(self.start)
        seen = View(*(self.keep(np.zeros(shape)) for shape in ((64, 3), 64, 64)))
        self.field.see(*self.rays[:2], seen)
        return [self.rt.to_numpy(a).copy() for a in seen]

    def loss(self, **changes):
        pairs = zip(self.look(**changes), self.gradients, strict=True)
        return sum((a.astype(float) * g[:RAYS]).sum() for a, g in pairs)

    def slopes(self):
        """Return the gradients of the table and of the layers."""
        self.look()
        scale = self.field.gradient_scale
        self.field.backward(Composited(*(self.keep(scale * g) for g in self.gradients)))
        parameters = self.field.table, self.field.layers
        return [self.rt.to_numpy(p.gradients) / F32(scale) for p in parameters]


@pytest.mark.parametrize("unbounded", [False, True])
def test_gradients_are_slopes(backend, unbounded, monkeypatch):
    # Where a step changes which sample is a ray's last there is a jump: all samples are taken.
    monkeypatch.setattr(march, "STOP", 0.0)
    trial = Trial(unbounded=unbounded)
    found = trial.slopes()
    assert 500 < trial.field.taken() < SETTINGS.samples
    for name, gradient in zip(("table.values", "layers.values"), found, strict=True):
        # Along the gradient, where the slope is steepest, and a random direction besides.
        unit = gradient / np.linalg.norm(gradient)
        across = np.random.default_rng(1).normal(size=unit.shape)
        for direction in (unit, unit + across / np.linalg.norm(across)):
            step = 0.025  # short: where a rectifier switches, the slope jumps
            ahead, behind = (
                trial.loss(**{name: (trial.start[name] + e * direction).astype(F32)})
                for e in (step, -step)
            )
            want = (ahead - behind) / (2 * step)
            # The loss, some 10, is rounded to 1e-5 in all, and changes by 0.06 at least.
            assert abs((gradient * direction).sum(dtype=float) - want) < 1e-3 * abs(want)


def test_gradients_are_equal_from_run_to_run(backend):
    first, second = (Trial().slopes() for _ in range(2))
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("unbounded", [False, True])
def test_the_sets_agree(unbounded):
    looks, slopes = [], []
    for backend in ("warp", "taichi"):
        with cvkern.use(backend=backend):
            trial = Trial(unbounded=unbounded)
            looks.append(trial.look())
            slopes.append(trial.slopes())
    for a, b in zip(*looks, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-4, atol=1e-5)  # sums of some 100, in any order
    for a, b in zip(*slopes, strict=True):
        assert np.abs(a - b).max() < 1e-4 * np.abs(a).max()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"levels": 12}, "levels must be a multiple of 8, got 12"),
        ({"levels": 40}, r"levels must be in \[8, 32\], got 40"),
        ({"table_bits": 25}, r"table_bits must be in \[3, 24\], got 25"),
        ({"finest": 15}, r"finest must be in \[16, 1048576\], got 15"),
        ({"samples": 512}, r"samples must be in \[1024, 16777216\], got 512"),
        ({"samples": 64, "steps": 65}, r"samples must be in \[65, 16777216\], got 64"),
        ({"steps": 1025}, r"steps must be in \[1, 1024\], got 1025"),
        ({"rays": 0}, r"rays must be in \[1, 16777216\], got 0"),
        ({"cells": 100}, "cells must be a multiple of 8, got 100"),
        ({"learning_rate": 0.0}, "learning_rate must be > 0, got 0.0"),
        ({"table_decay": -1.0}, "table_decay must be >= 0 and finite, got -1.0"),
    ],
)
def test_settings_are_checked(settings, message):
    with pytest.raises(ValueError, match=message):
        HashField(**settings)


@pytest.mark.parametrize("coarsest", [16, 2**14])
def test_the_finest_grid_of_tiny_pixels_is_that_which_settings_may_ask_for(backend, coarsest):
    """The kernels put the numbers of a cell into one, of 20 bits each."""
    settings = HashField(levels=8, table_bits=4, coarsest=coarsest, samples=2**11, rays=4, cells=8)
    field = settings.build(runtime(), Frame(Bounds((0, 0, 0), 1.0, False), 0.1, 9.0, 1e-30), 0)
    assert field.rt.to_numpy(field.grids[0]).tolist()[::7] == [coarsest, 2**20]


def test_the_finest_grid_has_three_cells_for_two_pixels():
    half, distance, focal = 1.5, 4.0, 278.0
    poses = np.array([[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, -distance]]], np.float64)
    views = cameras(poses, (focal, focal, 100.0, 100.0), 200, 200)
    for unbounded, side in ((False, 2 * half), (True, 4 * half)):
        bounds = Bounds((0.0, 0.0, 0.0), half, unbounded)
        scene = Scene(np.zeros((1, 200, 200, 3), np.uint8), views, np.array([False]), bounds, 1, 9)
        field = HashField(table_bits=8, samples=1024, rays=8, cells=8).build(
            runtime(), Frame.of(scene), 0
        )
        finest = field.rt.to_numpy(field.grids[0])[-1]
        assert abs(finest - 1.5 * side / (distance / focal)) < 1
