"""Losses of rendered colours against photographs, and their gradients, in Taichi.

Over a background B, a ray of colour C and opacity O has the colour F = C + (1 - O) B, and the
photograph, of colour S and opacity a, has P = a S + (1 - a) B. The loss of a ray is the mean over
the channels of l(F - P), where l is the square, or Huber's: e^2 / 2 for |e| < k and k (|e| - k / 2)
beyond. So with D = l' / 3,

    dL/dC = D,  dL/dO = -<D, B>,  dL/dB = D (a - O).

A camera clips what is too bright or too dark. If `censored`, there is no error where P is 1 and F
above, or P is 0 and F below, in pixels with a = 1.
"""

from typing import Any

import numpy as np
import taichi as ti

from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.codes.radiance import Background, Draw
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._random import random_unit
from cvkern.kernels.taichi.radiance._structs import Comparison

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
vec3 = ti.types.vector(3, ti.f32)


@ti.func
def background_of(
    comparison: ti.template(), learnt: ti.template(), step: ti.i32, ray: ti.i32
) -> vec3:
    """Return the background of a ray."""
    kind, seed = comparison.kind, comparison.seed
    color = vec3(0.0)
    if kind == Background.WHITE:
        color = vec3(1.0)
    elif kind == Background.RANDOM:
        for k in ti.static(range(3)):
            color[k] = random_unit(seed, step, ray, Draw.RED + k)
    elif kind == Background.LEARNT:
        color = vec3(learnt[0], learnt[1], learnt[2])
    return color


@ti.func
def error_of(error: ti.f32, target: ti.f32, seen: ti.f32, comparison: ti.template()) -> ti.f32:
    """Return the error of a channel, 0 beyond the end of the range that its photograph has."""
    clipped = (target >= 1.0 and error > 0.0) or (target <= 0.0 and error < 0.0)
    return 0.0 if comparison.censored and seen >= 1.0 and clipped else error


def comparison_of(c: codes.Comparison) -> Any:
    """Return the numbers of a comparison as a structure."""
    return Comparison(
        kind=c.kind, huber=c.huber, scale=c.scale, seed=c.seed, censored=int(c.censored)
    )


@ti.kernel
def _loss(
    color: f32_2,  # (R, 3)
    opacity: f32_1,  # (R,)
    targets: f32_2,  # (R, 4)
    active: i32_1,  # (1,)
    comparison: Comparison,
    learnt: f32_1,  # (3,)
    step: i32_1,  # (1,)
    # outputs
    errors: f32_1,  # (R,): mean squared error of each ray
    d_color: f32_2,  # (R, 3)
    d_opacity: f32_1,  # (R,)
    d_learnt: f32_2,  # (R, 3)
):
    for ray in range(opacity.shape[0]):
        if ray < active[0]:
            huber = comparison.huber
            behind = background_of(comparison, learnt, step[0], ray)
            through = 1.0 - opacity[ray]
            seen = targets[ray, 3]
            error = 0.0
            d_through = 0.0
            for k in ti.static(range(3)):
                found = color[ray, k] + through * behind[k]
                wanted = seen * targets[ray, k] + (1.0 - seen) * behind[k]
                e = error_of(found - wanted, targets[ray, k], seen, comparison)
                error += e * e / 3.0
                d = 2.0 * e
                if huber > 0.0:
                    d = ti.math.sign(e) * huber if ti.abs(e) > huber else e  # keeps NaN
                d *= comparison.scale / 3.0
                d_color[ray, k] = d
                d_through += d * behind[k]
                d_learnt[ray, k] = d * (seen - opacity[ray])
            errors[ray] = error
            d_opacity[ray] = -d_through
        else:
            errors[ray] = 0.0


@primitive
def loss(
    color: np.ndarray,
    opacity: np.ndarray,
    targets: np.ndarray,
    active: np.ndarray,
    comparison: codes.Comparison,
    errors: np.ndarray,
    d_color: np.ndarray,
    d_opacity: np.ndarray,
    d_learnt: np.ndarray,
) -> None:
    """Compute the squared error of each ray, and the gradients of its loss times a scale.

    `color` (R, 3) and `opacity` (R,) of the first `active` (1,) rays are compared with `targets`
    (R, 4), the colour and opacity of the photographs. `errors` (R,) are squared errors, averaged
    over the channels, for every loss, and 0 for the other rays. `d_color` (R, 3), `d_opacity` (R,)
    and `d_learnt` (R, 3), one row per ray, are not written for the other rays.
    """
    c, numbers = comparison, comparison_of(comparison)
    inputs = color, opacity, targets, active, numbers, c.learnt, c.step
    _loss(*inputs, errors, d_color, d_opacity, d_learnt)
