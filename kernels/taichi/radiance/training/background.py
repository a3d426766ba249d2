"""The gradient of a learnt background, in Taichi."""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)


@ti.kernel
def _gather(
    d_learnt: f32_2,  # (R, 3)
    active: i32_1,  # (1,)
    # outputs
    parts: f32_2,  # (P, 3)
    gradients: f32_1,  # (3,): added to
):
    for part, channel in parts:
        total = 0.0
        for k in range((active[0] - part + parts.shape[0] - 1) // parts.shape[0]):
            total += d_learnt[part + k * parts.shape[0], channel]
        parts[part, channel] = total
    for channel in gradients:
        total = 0.0
        for part in range(parts.shape[0]):
            total += parts[part, channel]
        gradients[channel] += total


@primitive
def gather(
    d_learnt: np.ndarray, active: np.ndarray, parts: np.ndarray, gradients: np.ndarray
) -> None:
    """Add `d_learnt` (R, 3) of the first `active` (1,) rays to `gradients` (3,).

    The order of the sum is always the same: rays are added in `parts` (P, 3), then the parts.
    """
    _gather(d_learnt, active, parts, gradients)
