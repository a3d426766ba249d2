"""What splats do in training beside Adam's steps, in Taichi [Kheradmand et al., 2024: 3DGS-MCMC].

The number of splats is fixed. Opacities o and sizes s cost a little, so that splats that are not
needed fade. After each step, a splat wanders by

    strength rate Sigma n / (1 + e^(100 (o - 0.005)))

with numbers n of mean 0 and variance 1, which are sums of four uniform ones, so that all devices
have the same.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes import splats as codes
from cvkern.kernels.codes.splats import Draw
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._random import random_bits

from ._placing import exponential, turn_of

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)

SPREAD = 3.0**0.5 / 65536.0  # makes the variance of four uniform numbers 1


@ti.kernel
def _restrain(
    scales: f32_2,  # (N, 3)
    opacities: f32_2,  # (N, 1)
    opacity: ti.f32,
    size: ti.f32,
    # outputs
    d_scales: f32_2,  # (N, 3)
    d_opacities: f32_2,  # (N, 1)
):
    for n in range(scales.shape[0]):
        o = 1.0 / (1.0 + exponential(-opacities[n, 0]))
        d_opacities[n, 0] = d_opacities[n, 0] + opacity * (o * (1.0 - o))
        for k in ti.static(range(3)):
            d_scales[n, k] = d_scales[n, k] + size * exponential(scales[n, k])


@primitive
def restrain(splats: codes.Splats, opacity: float, size: float, d_splats: codes.Splats) -> None:
    """Add the gradients of `opacity` times the sum of opacities, and `size` times that of sizes."""
    _restrain(
        splats.scales, splats.opacities, opacity, size, d_splats.scales, d_splats.opacities
    )  # fmt: skip


@ti.func
def _normal(seed: ti.i32, step: ti.i32, n: ti.i32, which: ti.i32) -> ti.f32:
    """Return a number of mean 0 and variance 1, nearly normal."""
    a = random_bits(seed, step, n, which)
    b = random_bits(seed, step, n, which + 1)
    half = ti.u32(0xFFFF)
    total = (a & half) + (a >> ti.u32(16)) + (b & half) + (b >> ti.u32(16))
    return (ti.cast(ti.cast(total, ti.i32), ti.f32) - 131070.0) * SPREAD


@ti.kernel
def _wander(
    rate: f32_1,  # (3,)
    strength: ti.f32,
    seed: ti.i32,
    step: i32_1,  # (1,)
    turns: f32_2,  # (N, 4)
    scales: f32_2,  # (N, 3)
    opacities: f32_2,  # (N, 1)
    # outputs
    means: f32_2,  # (N, 3)
):
    for n in range(means.shape[0]):
        o = 1.0 / (1.0 + exponential(-opacities[n, 0]))
        share = strength * rate[0] / (1.0 + exponential(100.0 * (o - 0.005)))
        w, x, y, z = turns[n, 0], turns[n, 1], turns[n, 2], turns[n, 3]
        length = ti.sqrt(w * w + x * x + y * y + z * z)
        if length > 1e-12:
            turn = turn_of(w / length, x / length, y / length, z / length)
            a = _normal(seed, step[0], n, ti.static(int(Draw.X)))
            b = _normal(seed, step[0], n, ti.static(int(Draw.Y)))
            c = _normal(seed, step[0], n, ti.static(int(Draw.Z)))
            for m in ti.static(range(3)):
                size = exponential(scales[n, m])
                along = turn[0, m] * a + turn[1, m] * b + turn[2, m] * c
                way = share * (size * size * along)
                for j in ti.static(range(3)):
                    means[n, j] = means[n, j] + turn[j, m] * way


@primitive
def wander(
    rate: np.ndarray, strength: float, seed: int, step: np.ndarray, splats: codes.Splats
) -> None:
    """Move faint splats at random; larger ones move farther."""
    _wander(
        rate, strength, seed, step, splats.turns, splats.scales, splats.opacities, splats.means
    )  # fmt: skip


@ti.kernel
def _move(
    rows: i32_2,  # (M, 2)
    # outputs
    values: f32_2,  # (N, C)
    mean: f32_2,  # (N, C)
    square: f32_2,  # (N, C)
):
    for m in range(rows.shape[0]):
        to, at = rows[m, 0], rows[m, 1]
        for k in range(values.shape[1]):
            values[to, k] = values[at, k]
            mean[to, k] = 0.0
            square[to, k] = 0.0


@ti.kernel
def _change(
    rows: i32_2,  # (M, 2)
    numbers: f32_2,  # (M, 2)
    # outputs
    scales: f32_2,  # (N, 3)
    opacities: f32_2,  # (N, 1)
):
    for m in range(rows.shape[0]):
        to = rows[m, 0]
        opacities[to, 0] = numbers[m, 0]
        for k in ti.static(range(3)):
            scales[to, k] = scales[to, k] + numbers[m, 1]


@primitive
def relocate(
    rows: np.ndarray,
    numbers: np.ndarray,
    splats: codes.Splats,
    mean: codes.Splats,
    square: codes.Splats,
) -> None:
    """Make M splats copies of others, and forget Adam's moments of them.

    `rows` (M, 2) int32 has the splats that change, each once, and the splats that they copy. A
    splat that copies itself changes too; the other sources do not change. `numbers` (M, 2) are
    their opacities, before the logistic function, and the changes of the logarithms of their sizes.
    """
    for values, first, second in zip(splats, mean, square, strict=True):
        if values.shape[1] > 1 or values.shape[0] == splats.means.shape[0]:
            _move(rows, values, first, second)
    _change(rows, numbers, splats.scales, splats.opacities)
