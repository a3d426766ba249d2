"""Logarithms of the ratio of an image and its surroundings, in Taichi.

Each scale of a retinex adds ``w log((I + c) / (S + c))``, where S is the smoothed image [D. Jobson,
Z. Rahman and G. Woodell, "A multiscale retinex for bridging the gap between color images and the
human observation of scenes", IEEE Transactions on Image Processing 6(7), 1997]. Logarithms agree
between devices to rounding. One thread takes a value.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)


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
