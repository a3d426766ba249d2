"""What estimates of the light are made of, in Taichi: block means of the pixels that count.

A pixel counts if it is finite, marked, dark enough not to be saturated, and above black in all
channels; a block counts if all its pixels do. Sums are in float64, in order.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.color import SATURATED, SLOTS
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._order import ordered
from cvkern.kernels.taichi._rounding import wide_product

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
f64_3 = ti.types.ndarray(dtype=ti.f64, ndim=3)
i64_1 = ti.types.ndarray(dtype=ti.i64, ndim=1)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)


@ti.kernel
def _peak(image: f32_2, keys: i64_1):
    for i in range(image.shape[0]):
        most = image[i, 0]
        finite = True
        for c in range(3):
            most = ti.max(most, image[i, c])
            finite = finite and ti.abs(image[i, c]) < ti.math.inf
        if finite:
            key = ti.cast(ordered(ti.bit_cast(most, ti.i32)), ti.i64) + ti.i64(2**32)
            ti.atomic_max(keys[i % SLOTS], key)


@primitive
def peak(image: np.ndarray, keys: np.ndarray) -> None:
    """Find the largest value of (N, 3) finite pixels, as SLOTS keys; one thread a pixel.

    A key is the bits as an integer of the same order, plus 2^32; 0 stands for no pixel.
    """
    _peak(image, keys)


@ti.kernel
def _gather(
    image: f32_3,
    mask: u8_2,
    black: ti.f64,
    scale: ti.f64,
    side: ti.i32,
    zero: ti.i32,
    # outputs
    values: f64_3,
    valid: u8_2,
):
    for y, x in valid:
        tall, wide = ti.min(side, image.shape[0]), ti.min(side, image.shape[1])
        sums = ti.Vector([0.0, 0.0, 0.0], dt=ti.f64)
        good = True
        for j in range(tall):
            for i in range(wide):
                v, u = y * tall + j, x * wide + i
                if mask.shape[0] > 0:
                    good = good and mask[v, u] != 0
                finite = True
                for c in range(3):
                    finite = finite and ti.abs(image[v, u, c]) < ti.math.inf
                good = good and finite
                for c in ti.static(range(3)):
                    value = wide_product(ti.cast(image[v, u, c], ti.f64) - black, scale, zero)
                    good = good and 0.0 < value < SATURATED
                    if finite:
                        sums[c] += value
        share = ti.f64(1.0) / ti.cast(tall * wide, ti.f64)
        for c in ti.static(range(3)):
            values[y, x, c] = wide_product(sums[c], share, zero)
        valid[y, x] = ti.cast(good, ti.u8)


@primitive
def gather(
    image: np.ndarray,
    mask: np.ndarray,
    black: float,
    scale: float,
    side: int,
    values: np.ndarray,
    valid: np.ndarray,
) -> None:
    """Write means of blocks of a side, less black and scaled, and whether all their pixels count.

    Without a mask that is of shape (0, 0). One thread a block.
    """
    _gather(image, mask, black, scale, side, 0, values, valid)
