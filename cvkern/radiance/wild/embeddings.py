"""The light of each photograph as numbers that a field's perceptron of colours is given."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cvkern._checks import FLOAT32_MAX, as_numbers, check_integer
from cvkern._runtime import Runtime
from cvkern.kernels.codes.radiance import LIGHT, LIGHT_PARTS, AdamRule, Lights
from cvkern.radiance.fields.hash import BETAS, EPSILON
from cvkern.radiance.models import APPEARANCE, Model
from cvkern.radiance.wild.tables import Table

RATE, WARMUP, FINAL = 0.02, 100, 0.1  # learning rate, steps until it is full, share at the end
DECAY = 1e-7  # weight decay towards no light at all
# The search for the light of a new photograph: most steps, the length of differences as a share of
# the deviation of the known lights, and their least deviation; the weight of the known lights.
STEPS, APART, LEAST, PRIOR = 12, 0.1, 0.02, 1e-4
ENOUGH = 1e-3  # share of the error by which a step must lower it, or the search ends


class Embedding(Table):
    """The lights of the training photographs, being learnt."""

    prefix, rates = APPEARANCE, (RATE, WARMUP, FINAL)
    rule = AdamRule(*BETAS, EPSILON, DECAY)

    def __init__(self, rt: Runtime, images: int, rays: int):
        super().__init__(rt, np.zeros((images, LIGHT)))
        self._d_rays = rt.zeros((rays, LIGHT))
        self._parts = rt.zeros((LIGHT_PARTS, images, LIGHT))

    def lights(self, views: Any) -> Lights:
        """Return the lights of rays whose photographs are `views` (R,)."""
        return Lights(self.table.values, views)

    def backward(self, field: Any, views: Any, active: Any) -> None:
        """Sum the gradients of the last backward pass of a `SampledField` by photographs."""
        kernels = self.rt.radiance.wild.embeddings
        kernels.sum_rays(field.d_lights, field.spans, active, self._d_rays)
        kernels.sum_views(self._d_rays, views, active, self._parts, self.table.gradients)


def search(known: np.ndarray, errors: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Return the light (16,) of least squared errors, by Levenberg's and Marquardt's steps.

    `known` (N, 16) are the lights of other photographs; the light is preferred weakly near their
    mean. `errors` returns the errors (E,) of a light; differences give their slopes.
    """
    middle = known.mean(axis=0)
    spread = np.maximum(known.std(axis=0), LEAST)
    light, damping = middle.copy(), 1e-3

    def residuals(at: np.ndarray) -> np.ndarray:
        found = errors(at)
        return np.concatenate((found, np.sqrt(PRIOR * len(found)) * (at - middle) / spread))

    now = residuals(light)
    for _ in range(STEPS):
        slopes = np.empty((len(now), LIGHT))
        for k in range(LIGHT):
            moved = light.copy()
            moved[k] += APART * spread[k]
            slopes[:, k] = (residuals(moved) - now) / APART  # by shares of the deviation
        system, pull = slopes.T @ slopes, slopes.T @ now
        before = now @ now
        while damping < 1e3:
            scaled = system + damping * np.diag(np.diag(system))
            tried = light - spread * np.linalg.solve(scaled, pull)
            after = residuals(tried)
            if after @ after < before:
                break
            damping *= 10
        else:
            return light
        light, now, damping = tried, after, damping / 10
        if before - now @ now < ENOUGH * before:
            break
    return light


def light_of(model: Model, appearance: Any) -> np.ndarray | None:
    """Return a light for the kernels, or None if the model has one light only.

    It is what a map of colours adds to them, (1, 12) float32, or the 16 numbers that the field is
    given, (1, 16).
    """
    if appearance is None:
        if model.appearance is None:
            return None
        appearance = model.gauge
    if isinstance(appearance, (int, np.integer)) and not isinstance(appearance, bool):
        index = check_integer(appearance, "appearance", 0, len(model.cameras) - 1)
        found = model.appearances[index]
    else:
        found, shape = as_numbers(appearance, "appearance"), model.appearances.shape[1:]
        if found.shape != shape or not (np.abs(found) <= FLOAT32_MAX).all():
            raise ValueError(
                f"appearance must be a photograph's number, or {shape} finite numbers, got "
                f"{np.array(appearance).tolist()}"
            )
    if model.appearance == "embedding":
        return found.astype(np.float32).reshape(1, LIGHT)
    return (found - np.eye(3, 4)).astype(np.float32).reshape(1, 12)
