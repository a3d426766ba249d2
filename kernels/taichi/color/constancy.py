"""What estimates of the light are made of, in Taichi: block means of the pixels that count, maps.

A pixel counts if it is finite, marked, dark enough not to be saturated, and above black in all
channels; a block counts if all its pixels do. Sums are in float64, in order.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.color import SATURATED, SLOTS
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._order import key_of
from cvkern.kernels.taichi._rounding import product, root, wide_product
from cvkern.kernels.taichi.raw._powers import log2

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
i64_1 = ti.types.ndarray(dtype=ti.i64, ndim=1)
u8_1 = ti.types.ndarray(dtype=ti.u8, ndim=1)
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
            ti.atomic_max(keys[i % SLOTS], key_of(most))


@primitive
def peak(image: np.ndarray, keys: np.ndarray) -> None:
    """Find the largest value of (N, 3) finite pixels, as SLOTS keys; one thread a pixel.

    Keys are those of `key_of`; 0 stands for no pixel.
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
    values: f32_3,
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
                    good = good and 0.0 < value < ti.f64(SATURATED)
                    if finite:
                        sums[c] += value
        share = ti.f64(1.0) / ti.cast(tall * wide, ti.f64)
        for c in ti.static(range(3)):
            values[y, x, c] = ti.cast(wide_product(sums[c], share, zero), ti.f32)
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


@ti.kernel
def _inner(valid: u8_2, out: u8_2):
    height, width = valid.shape[0], valid.shape[1]
    for y, x in out:
        good = 3 <= y < height - 3 and 3 <= x < width - 3
        for j in range(-3, 4):
            wide = 3 - ti.abs(j)
            for i in range(-wide, wide + 1):
                v, u = ti.math.clamp(y + j, 0, height - 1), ti.math.clamp(x + i, 0, width - 1)
                good = good and valid[v, u] != 0
        out[y, x] = ti.cast(good, ti.u8)


@primitive
def inner(valid: np.ndarray, out: np.ndarray) -> None:
    """Mark the pixels from which all within three steps, up, down or aside, count.

    One thread a pixel.
    """
    _inner(valid, out)


@ti.kernel
def _lengths(a: f32_1, b: f32_1, c: f32_1, factor: ti.f32, zero: ti.i32, out: f32_1):
    for i in out:
        squares = product(a[i], a[i], zero) + product(b[i], b[i], zero)
        out[i] = root(squares + product(factor, product(c[i], c[i], zero), zero), zero)


@primitive
def lengths(a: np.ndarray, b: np.ndarray, c: np.ndarray, factor: float, out: np.ndarray) -> None:
    """Write the roots of a^2 + b^2 + factor c^2 of (N,) values; one thread a value."""
    _lengths(a, b, c, factor, 0, out)


@ti.kernel
def _contrasts(a: f32_2, b: f32_2, among: u8_1, least: ti.f32, out: u8_1):
    for i in out:
        good = among[i] != 0
        for c in ti.static(range(3)):
            good = good and ti.abs(a[i, c] + b[i, c]) > least
        out[i] = ti.cast(good, ti.u8)


@primitive
def contrasts(
    a: np.ndarray, b: np.ndarray, among: np.ndarray, least: float, out: np.ndarray
) -> None:
    """Mark the pixels among some where a + b exceeds `least` in all of three channels, (N, 3).

    One thread a pixel.
    """
    _contrasts(a, b, among, least, out)


@ti.func
def _logarithm(x: ti.f32, zero: ti.i32) -> ti.f32:
    return log2(ti.max(x, 0.0) + 1e-10, zero)


@ti.kernel
def _logarithms(means: f32_2, zero: ti.i32, out: f32_2):
    for i in range(out.shape[0]):
        total = _logarithm((means[i, 0] + means[i, 1]) + means[i, 2], zero)
        out[i, 0] = _logarithm(means[i, 0], zero) - total
        out[i, 1] = _logarithm(means[i, 2], zero) - total


@primitive
def logarithms(means: np.ndarray, out: np.ndarray) -> None:
    """Write log2 of red and of blue (N, 3), less that of the sum: (N, 2). None are below 1e-10.

    One thread a pixel.
    """
    _logarithms(means, 0, out)


@ti.kernel
def _sizes(a: f32_2, b: f32_2, zero: ti.i32, out: f32_1):
    for i in out:
        u, v = a[i, 0] + b[i, 0], a[i, 1] + b[i, 1]
        out[i] = root(product(u, u, zero) + product(v, v, zero), zero)


@primitive
def sizes(a: np.ndarray, b: np.ndarray, out: np.ndarray) -> None:
    """Write the lengths of the vectors a + b, (N, 2); one thread a vector."""
    _sizes(a, b, 0, out)
