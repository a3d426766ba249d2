"""Logarithms of the ratio of an image and its surroundings, or its neighbours, in Taichi.

Each scale of a retinex adds ``w log((I + c) / (S + c))``, where S is the smoothed image [D. Jobson,
Z. Rahman and G. Woodell, "A multiscale retinex for bridging the gap between color images and the
human observation of scenes", IEEE Transactions on Image Processing 6(7), 1997]. By gradients, a
step between neighbours counts if their ratio is above a threshold [J. M. Morel, A. B. Petro and
C. Sbert, "A PDE formalization of retinex theory", IEEE Transactions on Image Processing 19(11),
2010]; ratios are compared by a product, so that all devices keep the same steps. Logarithms agree
between devices to rounding. One thread takes a value or a pixel.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._rounding import product

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
f64_2 = ti.types.ndarray(dtype=ti.f64, ndim=2)


@ti.kernel
def _add_log_ratio(image: f32_1, smooth: f32_1, low: ti.f32, weight: ti.f32, out: f32_1):
    for i in range(out.shape[0]):
        here = ti.max(image[i], 0.0) + low
        around = ti.max(smooth[i], 0.0) + low
        out[i] += weight * ti.log(here / around)


@primitive
def add_log_ratio(
    image: np.ndarray, smooth: np.ndarray, low: float, weight: float, out: np.ndarray
) -> None:
    """Add the weighted logarithm of an image over its surroundings, both raised by `low`.

    One thread a value.
    """
    _add_log_ratio(image, smooth, low, weight, out)


@ti.kernel
def _steps(
    image: f32_3,
    channel: ti.i32,
    low: ti.f32,
    ratio: ti.f32,
    zero: ti.i32,
    # outputs
    weights: f32_3,
    rises: f32_3,
):
    for y, x in ti.ndrange(image.shape[0], image.shape[1]):
        here = ti.max(image[y, x, channel], 0.0) + low
        for axis in ti.static(range(2)):
            v, u = y + axis, x + 1 - axis
            weight, rise = 0.0, 0.0
            if v < image.shape[0] and u < image.shape[1]:
                weight = 1.0
                there = ti.max(image[v, u, channel], 0.0) + low
                if there > product(here, ratio, zero) or here > product(there, ratio, zero):
                    rise = ti.log(there / here)
            weights[axis, y, x] = weight
            rises[axis, y, x] = rise


@primitive
def steps(
    image: np.ndarray,
    channel: int,
    low: float,
    ratio: float,
    weights: np.ndarray,
    rises: np.ndarray,
) -> None:
    """Write the logarithms of ratios to the right and below, 0 of small ones, and where they are.

    `image` (H, W, C) is raised by `low`; outputs are (2, H, W). One thread a pixel.
    """
    _steps(image, channel, low, ratio, 0, weights, rises)


@ti.kernel
def _put(values: f64_2, mean: ti.f64, channel: ti.i32, out: f32_3):
    for y, x in values:
        out[y, x, channel] = ti.cast(values[y, x] - mean, ti.f32)


@primitive
def put(values: np.ndarray, mean: float, channel: int, out: np.ndarray) -> None:
    """Write values less their mean to a channel; one thread a pixel."""
    _put(values, mean, channel, out)
