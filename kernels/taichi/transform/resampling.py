"""Resizing by weighted means, down the rows and then along the columns, in Taichi.

Pixel i of the result along an axis is ``sum_k w_ik s_(b_i + k)``: the host chooses the starts b and
the weights w, which are shares of areas for a smaller image and linear ones for a larger one. Sums
are in float32, in the order of k. One thread takes a pixel of a pass.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi._rounding import product

from ._taps import stored

i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
any_3 = ti.types.ndarray(ndim=3)  # u8 or f32


@primitive
def resample(
    src: np.ndarray,
    tops: np.ndarray,
    down: np.ndarray,
    starts: np.ndarray,
    along: np.ndarray,
    dst: np.ndarray,
) -> None:
    """Weigh the pixels of a column from the top of each row on, then those of each row alike.

    One thread an element and pass.
    """
    planes, height, width, channels = src.shape
    tall, wide = dst.shape[1:3]
    middle = scratch((planes, tall, width * channels), np.float32)
    _resample(src.reshape(planes, height, -1), tops, down, False, 0, middle)
    lines = middle.reshape(planes * tall, width, channels)
    result = dst.reshape(planes * tall, wide, channels)
    _resample(lines, starts, along, dst.dtype == np.uint8, 0, result)


@ti.kernel
def _resample(
    src: any_3,  # (outer, n, inner)
    starts: i32_1,  # (m,)
    weights: f32_2,  # (m, T)
    rounded: ti.template(),
    zero: ti.i32,
    # outputs
    dst: any_3,  # (outer, m, inner)
):
    for o, k, i in ti.ndrange(dst.shape[0], dst.shape[1], dst.shape[2]):
        total = ti.cast(zero, ti.f32)  # not a constant: 0 + -0 is 0
        for t in range(weights.shape[1]):
            if weights[k, t] != 0.0:
                v = ti.cast(src[o, starts[k] + t, i], ti.f32)
                total = total + product(weights[k, t], v, zero)
        if ti.static(rounded):
            dst[o, k, i] = ti.cast(stored(total), ti.u8)
        else:
            dst[o, k, i] = total
