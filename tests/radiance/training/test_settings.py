"""Named settings learn, and each option reaches the primitive that it is for."""

import importlib
from dataclasses import replace

import numpy as np
import pytest

from cvkern.radiance import evaluate, fit, make_scene, trainer
from cvkern.radiance.fields import hash as hash_field
from cvkern.radiance.training import suited
from tests.radiance.runs import GRID, TINY

# Smaller tables, grids and batches than the settings by name have; rates and decays are theirs.
SMALL = {
    "voxel": {"resolutions": (16, 32), "shares": (0.3,), "rays": 512},
    "hash": {"samples": 4096, "rays": 512, "cells": 32, "table_bits": 12, "steps": 128},
    "mlp": {"samples": 2048, "rays": 128, "cells": 32, "steps": 64, "width": 64, "layers": 3,
            "skip": 2},
}  # fmt: skip
# Measured after 300 steps, dB; an empty picture has 11.
LEARNT = {"voxel": 26.7, "hash": 21.4, "mlp": 20.8}


@pytest.fixture(scope="module")
def scene():
    return make_scene(train=16, test=2, size=24)


@pytest.mark.parametrize("name", SMALL)
def test_named_settings_learn(scene, name):
    model = fit(scene, replace(suited(name), **SMALL[name]), steps=300, seed=1)
    assert evaluate(model, scene).psnr.mean() > LEARNT[name] - 1


@pytest.fixture
def given(monkeypatch):
    """Return the arguments of the primitives of training, by their names."""
    seen = {}
    for place, name in (
        ("pinhole", "random_rays"), ("training.losses", "loss"), ("training.adam", "adam"),
        ("training.adam", "learning_rate"),
    ):  # fmt: skip
        module = importlib.import_module(f"cvkern.kernels.warp.radiance.{place}")

        monkeypatch.setattr(module, name, _noting(getattr(module, name), seen, name))
    return seen


def _noting(call, seen, name):
    seen[name] = []

    def noted(*arguments):
        seen[name].append(arguments)
        call(*arguments)

    return noted


FIELD = replace(
    TINY, learning_rate=0.007, final_rate=0.2, weight_decay=3e-5, table_decay=5e-6
)  # unlike any default


def test_options_reach_the_rays_and_the_loss(scene, given):
    fit(scene, FIELD, steps=1, spread=0.75, loss="huber", seed=4)
    rays, loss = given["random_rays"][0], given["loss"][0]
    assert rays[2:4] == (0.75, 4)
    (comparison,) = (a for a in loss if hasattr(a, "_fields"))
    assert comparison.huber == trainer.HUBER > 0
    assert comparison.seed == 4
    for calls in given.values():
        calls.clear()
    fit(scene, FIELD, steps=1)
    assert given["random_rays"][0][2:4] == (0.0, 0)
    (comparison,) = (a for a in given["loss"][0] if hasattr(a, "_fields"))
    assert comparison.huber == 0


@pytest.mark.parametrize(
    ("field", "options", "bends"),
    [
        (FIELD, {"appearance": "affine"}, [trainer.GLOSS, 0.0]),
        (FIELD, {"appearance": "affine", "loss": "huber"}, [trainer.GLOSS, trainer.HUBER]),
        (FIELD, {"appearance": "embedding"}, [0.0]),
        (GRID, {"appearance": "affine"}, [0.0]),  # its colours always depend on the side
    ],
)
def test_highlights_count_little_while_lights_are_learnt(scene, given, field, options, bends):
    fit(scene, field, steps=40, **options)
    found = [a.huber for call in given["loss"] for a in call if hasattr(a, "_fields")]
    assert list(dict.fromkeys(found)) == bends


def test_rates_and_decays_of_a_table_reach_the_optimizer(scene, given):
    fit(scene, FIELD, steps=1, background="white")
    assert [a[2:5] for a in given["learning_rate"]] == [(0.007, 100, 0.2)]
    table, layers = (a[2] for a in given["adam"])
    assert (table.decay, table.sparse) == (5e-6, False)
    assert (layers.decay, layers.sparse) == (3e-5, False)


@pytest.mark.parametrize("share", [2.0, 1.0, 0.25])
def test_tables_decay_less_for_many_pixels(scene, given, monkeypatch, share):
    pixels = np.prod(scene.images[~scene.test].shape[:3])
    monkeypatch.setattr(hash_field, "DECAY_PIXELS", share * pixels)
    fit(scene, replace(FIELD, table_decay=None), steps=1)
    assert given["adam"][0][2].decay == pytest.approx(1e-7 * min(share, 1.0))


def test_rates_of_a_grid_reach_the_optimizer(scene, given):
    fit(scene, replace(GRID, density_rate=0.3, color_rate=0.05, final_rate=0.4), steps=1)
    rates = [a[2::2] for a in given["learning_rate"]]
    assert [rate[:2] for rate in rates] == [(0.3, 0.4), (0.05, 0.4)]
