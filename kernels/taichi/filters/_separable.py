"""The two passes of a separable filter in Taichi; one thread per element.

A pass is ``out[i] = sum over t of taps[t] * in[i + t - r]``, summed in the order of the taps.
"""

import taichi as ti

from cvkern.kernels.taichi._borders import border_index
from cvkern.kernels.taichi._rounding import product

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)


@ti.kernel
def correlate_down(
    src: f32_3,  # (planes, rows, row length)
    taps: f32_1,
    border: ti.i32,
    cval: ti.f32,
    zero: ti.i32,
    # outputs
    dst: f32_3,
):
    for p, y, x in dst:
        acc = 0.0
        for t in range(taps.shape[0]):
            j = border_index(y + t - taps.shape[0] // 2, src.shape[1], border)
            v = cval
            if j >= 0:
                v = src[p, j, x]
            acc = acc + product(taps[t], v, zero)
        dst[p, y, x] = acc


@ti.kernel
def correlate_along(
    src: f32_3,  # (planes, rows, columns * step)
    taps: f32_1,
    step: ti.i32,
    border: ti.i32,
    cval: ti.f32,
    zero: ti.i32,
    # outputs
    dst: f32_3,
):
    for p, y, i in dst:
        x = i // step
        acc = 0.0
        for t in range(taps.shape[0]):
            j = border_index(x + t - taps.shape[0] // 2, src.shape[2] // step, border)
            v = cval
            if j >= 0:
                v = src[p, y, i + (j - x) * step]
            acc = acc + product(taps[t], v, zero)
        dst[p, y, i] = acc
