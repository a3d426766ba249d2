"""Adam [Kingma and Ba 2015], learning rates and gradient clipping, in Taichi."""

import numpy as np
import taichi as ti

from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi.radiance._fixed_point import fraction

from ._adam_step import adam_step

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
i64_1 = ti.types.ndarray(dtype=ti.i64, ndim=1)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)


@ti.kernel
def _adam(
    rate: f32_1,  # (3,): of learning, and what the two means have to be divided by
    factor: f32_1,  # (1,): of the gradients
    beta1: ti.f32,
    beta2: ti.f32,
    epsilon: ti.f32,
    decay: ti.f32,
    sparse: ti.i32,
    # outputs
    gradients: f32_1,  # (N,): set to 0
    mean: f32_1,  # (N,)
    square: f32_1,  # (N,)
    weights: f32_1,  # (N,)
    copy: f32_1,  # (N,): the weights again
):
    for i in range(weights.shape[0]):
        g = gradients[i] * factor[0]
        gradients[i] = 0.0
        # Entries of a table that no sample touched stay unchanged.
        if sparse == 0 or g != 0.0:
            w = weights[i]
            g += decay * w
            mean[i], square[i], weights[i] = adam_step(
                g, mean[i], square[i], w, rate, beta1, beta2, epsilon
            )
            copy[i] = weights[i]


@primitive
def adam(
    rate: np.ndarray,
    factor: np.ndarray,
    rule: codes.AdamRule,
    learnt: codes.Learnt,
    copy: np.ndarray,
) -> None:
    """Take a step of Adam for N weights, with their gradients times `factor` (1,); reset these.

    `rate` (3,) is that of :func:`learning_rate`. `copy` (N,) is filled with the weights in its own
    precision; it may be the array of weights itself. On CUDA each array begins at a multiple of 16
    bytes.
    """
    _adam(rate, factor, *rule, *learnt, copy)


@ti.kernel
def _collect(
    # outputs
    sums: i64_1,  # (N,): set to 0
    gradients: f32_1,  # (N,): added to
):
    for i in range(sums.shape[0]):
        gradients[i] += fraction(sums[i])
        sums[i] = 0


@primitive
def collect(sums: np.ndarray, gradients: np.ndarray) -> None:
    """Add `sums` (N,), int64 fixed-point numbers, to `gradients` (N,), and reset the sums to 0.

    Gradients are collected in these sums if the order must have no effect. On CUDA each array
    begins at a multiple of 16 bytes.
    """
    _collect(sums, gradients)


@ti.kernel
def _learning_rate(
    step: i32_1,  # (1,)
    progress: f32_1,  # (1,): share of the training that is done
    base: ti.f32,
    warmup: ti.i32,
    final: ti.f32,
    beta1: ti.f32,
    beta2: ti.f32,
    # outputs
    rate: f32_1,  # (3,)
):
    for _ in range(1):
        steps = ti.cast(step[0] + 1, ti.f32)
        warm = ti.min(1.0, steps / ti.max(warmup, 1))
        rate[0] = base * warm * final ** progress[0]
        # Both means begin at 0, so they are too small by these factors.
        rate[1] = 1.0 - beta1**steps
        rate[2] = 1.0 - beta2**steps


@primitive
def learning_rate(
    step: np.ndarray,
    progress: np.ndarray,
    base: float,
    warmup: int,
    final: float,
    beta1: float,
    beta2: float,
    rate: np.ndarray,
) -> None:
    """Increase a rate linearly over `warmup` steps, and decrease it exponentially to `final` of it.

    `rate` (3,) is filled for step `step` (1,) at `progress` (1,): the rate, and the divisors of the
    two means of Adam.
    """
    _learning_rate(step, progress, base, warmup, final, beta1, beta2, rate)


@ti.kernel
def _add_squares(
    gradients: f32_1,  # (N,)
    # outputs
    parts: f32_1,  # (P,): added to
):
    for part in range(parts.shape[0]):
        total = 0.0
        for turn in range((gradients.shape[0] - part + parts.shape[0] - 1) // parts.shape[0]):
            g = gradients[part + turn * parts.shape[0]]
            total += g * g
        parts[part] = parts[part] + total


@primitive
def add_squares(gradients: np.ndarray, parts: np.ndarray) -> None:
    """Add the squares of `gradients` (N,) to `parts` (P,), always in the same order.

    On CUDA the gradients begin at a multiple of 16 bytes.
    """
    _add_squares(gradients, parts)


@ti.kernel
def _clip(
    scale: ti.f32,
    most: ti.f32,
    # outputs
    parts: f32_1,  # (P,): set to 0
    factor: f32_1,  # (1,)
):
    for _ in range(1):
        total = 0.0
        for part in range(parts.shape[0]):
            total += parts[part]
            parts[part] = 0.0
        norm = ti.sqrt(total) * scale
        factor[0] = scale
        if norm > most:
            factor[0] = scale * (most / norm)


@primitive
def clip(scale: float, most: float, parts: np.ndarray, factor: np.ndarray) -> None:
    """Set `factor` (1,) to `scale`, or to less if the norm of the result would exceed `most`.

    The sum of `parts` (P,) is the squared norm of the gradients; the parts are reset to 0.
    """
    _clip(scale, most, parts, factor)


@ti.kernel
def _advance(
    # outputs
    step: i32_1,  # (1,)
):
    for _ in range(1):
        step[0] = step[0] + 1


@primitive
def advance(step: np.ndarray) -> None:
    """Add 1 to `step` (1,)."""
    _advance(step)
