"""Differences of the levels of a Laplacian pyramid, in Taichi.

A level is the image minus what its next smaller version shows at the same size [P. Burt and
E. Adelson, "The Laplacian pyramid as a compact image code", IEEE Trans. Communications 31, 1983].
One thread takes an element.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)


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
