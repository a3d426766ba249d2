"""Parameters of texels, their values, and their steps of Adam, in Taichi.

A texel has the parameters (r, s): its colours and its opacity are logistic functions,
c = 1 / (1 + e^-r) and a = 1 / (1 + e^-s), and its value is (a c, a). From gradients (G, g) by the
value,

    dL/dr = a G c (1 - c),    dL/ds = a (1 - a) (<G, c> + g).
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi.radiance.training._adam_step import adam_step

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
vec4 = ti.types.vector(4, ti.f32)


@ti.func
def _logistic(x: ti.f32) -> ti.f32:
    return 1.0 / (1.0 + ti.exp(-x))


@ti.func
def _write_value(parameters: ti.template(), values: ti.template(), i: ti.i32):
    """Compute the value of a texel."""
    opacity = _logistic(parameters[i, 3])
    for k in ti.static(range(3)):
        values[i, k] = opacity * _logistic(parameters[i, k])
    values[i, 3] = opacity


@ti.kernel
def _values(
    parameters: f32_2,  # (N, 4)
    # outputs
    values: f32_2,  # (N, 4)
):
    for i in range(values.shape[0]):
        _write_value(parameters, values, i)


@primitive
def values(parameters: np.ndarray, found: np.ndarray) -> None:
    """Compute the values (D, H, W, 4) of texels from their parameters of the same shape."""
    _values(parameters.reshape((-1, 4)), found.reshape((-1, 4)))


@ti.kernel
def _learn(
    rate: f32_1,  # (3,)
    factor: f32_1,  # (1,)
    beta1: ti.f32,
    beta2: ti.f32,
    epsilon: ti.f32,
    # outputs
    gradients: f32_2,  # (N, 4): set to 0
    mean: f32_2,  # (N, 4)
    square: f32_2,  # (N, 4)
    parameters: f32_2,  # (N, 4)
    values: f32_2,  # (N, 4)
):
    for i in range(values.shape[0]):
        g = vec4(gradients[i, 0], gradients[i, 1], gradients[i, 2], gradients[i, 3])
        if g[0] != 0.0 or g[1] != 0.0 or g[2] != 0.0 or g[3] != 0.0:
            g *= factor[0]
            a = values[i, 3]
            total = g[3]
            slope = vec4(0.0)
            for k in ti.static(range(3)):
                c = _logistic(parameters[i, k])
                slope[k] = a * g[k] * c * (1.0 - c)
                total += g[k] * c
            slope[3] = a * (1.0 - a) * total
            for k in ti.static(range(4)):
                gradients[i, k] = 0.0
                mean[i, k], square[i, k], parameters[i, k] = adam_step(
                    slope[k], mean[i, k], square[i, k], parameters[i, k], rate, beta1, beta2,
                    epsilon,
                )  # fmt: skip
            _write_value(parameters, values, i)


@primitive
def learn(
    rate: np.ndarray,
    factor: np.ndarray,
    rule: codes.AdamRule,
    learnt: codes.Learnt,
    values: np.ndarray,
) -> None:
    """Take a step of Adam for texels with gradients by their `values`, times `factor` (1,).

    All arrays are (D, H, W, 4). `rate` (3,) is that of `training.adam.learning_rate`. The gradients
    are reset to 0, and the values computed again. A texel whose gradients are all 0 keeps its
    moments, as if `rule` were sparse; there is no weight decay.
    """
    arrays = (a.reshape((-1, 4)) for a in (*learnt, values))
    _learn(rate, factor, *rule[:3], *arrays)
