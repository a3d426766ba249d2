"""Differences of the levels of a Laplacian pyramid, and every so many pixels, in Taichi.

A level is the image minus what its next smaller version shows at the same size [P. Burt and
E. Adelson, "The Laplacian pyramid as a compact image code", IEEE Trans. Communications 31, 1983].
One thread takes an element.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)


@primitive
def subtract(a: np.ndarray, b: np.ndarray, dst: np.ndarray) -> None:
    """Subtract b from a; one thread an element."""
    _subtract(a, b, dst)


@ti.kernel
def _subtract(
    a: f32_1,
    b: f32_1,
    # outputs
    dst: f32_1,
):
    for i in dst:
        dst[i] = a[i] - b[i]


@primitive
def thin(src: np.ndarray, step: int, dst: np.ndarray) -> None:
    """Take every `step`-th row and column; one thread a pixel of the result."""
    _thin(src, step, dst)


@ti.kernel
def _thin(
    src: f32_2,
    step: ti.i32,
    # outputs
    dst: f32_2,
):
    for y, x in dst:
        dst[y, x] = src[y * step, x * step]
