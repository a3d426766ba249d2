"""Density and colour from the outputs of a perceptron, forward and backward, in Taichi.

With s = exp(h), ds/dh = s; with c = 1 / (1 + exp(-r)), dc/dr = c (1 - c). The density is clamped at
e^11, but the gradient by h does not become 0 there, so that the density can decrease again. One
thread per sample.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.radiance import MOST_LOG_DENSITY, MOST_LOG_DENSITY_GRADIENT
from cvkern.kernels.taichi._launch import primitive

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)


@ti.kernel
def _forward(
    hidden: f32_2,  # (M, >= 1)
    raw: f32_2,  # (M, >= 3)
    total: i32_1,  # (1,)
    # outputs
    sigma: f32_1,  # (M,)
    rgb: f32_2,  # (M, 3)
):
    for i in range(ti.min(total[0], sigma.shape[0])):
        sigma[i] = ti.exp(ti.min(hidden[i, 0], MOST_LOG_DENSITY))
        for k in range(3):
            rgb[i, k] = 1.0 / (1.0 + ti.exp(-raw[i, k]))


@primitive
def forward(
    hidden: np.ndarray, raw: np.ndarray, total: np.ndarray, sigma: np.ndarray, rgb: np.ndarray
) -> None:
    """``sigma = exp(hidden[:, 0])`` (M,), ``rgb = 1 / (1 + exp(-raw[:, :3]))`` (M, 3).

    All functions of this module process the first `total` (1,) rows.
    """
    _forward(hidden, raw, total, sigma, rgb)


@ti.kernel
def _color_backward(
    d_rgb: f32_2,  # (M, 3)
    rgb: f32_2,  # (M, 3)
    total: i32_1,  # (1,)
    # outputs
    d_raw: f32_2,  # (M, >= 3): 0 behind the third column
):
    for i in range(ti.min(total[0], rgb.shape[0])):
        for k in range(d_raw.shape[1]):
            d = 0.0
            if k < 3:
                d = d_rgb[i, k] * rgb[i, k] * (1.0 - rgb[i, k])
            d_raw[i, k] = d


@primitive
def color_backward(
    d_rgb: np.ndarray, rgb: np.ndarray, total: np.ndarray, d_raw: np.ndarray
) -> None:
    """Compute `d_raw` (M, >= 3) from the gradient by `rgb` (M, 3); it is 0 after column 2."""
    _color_backward(d_rgb, rgb, total, d_raw)


@ti.kernel
def _density_backward(
    d_sigma: f32_1,  # (M,)
    sigma: f32_1,  # (M,)
    total: i32_1,  # (1,)
    # outputs
    d_hidden: f32_2,  # (M, >= 1): column 0 is added to
):
    for i in range(ti.min(total[0], sigma.shape[0])):
        d = d_sigma[i] * sigma[i]
        if ti.abs(d) > MOST_LOG_DENSITY_GRADIENT:  # keeps NaN
            d = ti.math.sign(d) * MOST_LOG_DENSITY_GRADIENT
        d_hidden[i, 0] = d_hidden[i, 0] + d


@primitive
def density_backward(
    d_sigma: np.ndarray, sigma: np.ndarray, total: np.ndarray, d_hidden: np.ndarray
) -> None:
    """Add the gradient by the exponent, clipped to +-30000, to column 0 of (M, >= 1)."""
    _density_backward(d_sigma, sigma, total, d_hidden)
