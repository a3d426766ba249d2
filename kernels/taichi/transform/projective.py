"""Images seen through a homography, in Taichi: the map and the sample in one kernel.

Pixel q = (x, y, 1) of the result shows the place ``p ~ H^-1 q`` of the image, sampled with a spline
of order 0, 1 or 3 (_taps.py). The map is in float64. Bytes become bytes, linearly, in whole steps:
the place is rounded to 2^-23 of a pixel, and the weights are integers whose sum is 2^23. One thread
takes a pixel.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.transform import MIDDLE, OUTSIDE, PLACE_BITS, START, WIDEST
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._rounding import wide_product

from ._taps import first_tap, mapped, sample, stored, tap_index, weights, whole

f64_1 = ti.types.ndarray(dtype=ti.f64, ndim=1)
any_4 = ti.types.ndarray(ndim=4)  # u8 or f32


@primitive
def warp_perspective(
    src: np.ndarray,
    inverse: np.ndarray,
    order: int,
    border: int,
    cval: float,
    margin: int,
    dst: np.ndarray,
) -> None:
    """Sample an image where `inverse` takes the pixels of the result; one thread a pixel."""
    rounded = dst.dtype == np.uint8
    steps = rounded and src.dtype == np.uint8 and order == 1
    _warp(src, inverse, order, rounded, steps, border, cval, margin, 0, dst)


@ti.func
def _combined(h: ti.template(), row: ti.i32, u: ti.f64, v: ti.f64, zero: ti.i32) -> ti.f64:
    """Return one row of the matrix times (u, v, 1)."""
    a = wide_product(h[3 * row], u, zero)
    return a + wide_product(h[3 * row + 1], v, zero) + h[3 * row + 2]


@ti.func
def _of_row(h: ti.template(), row: ti.i32, u: ti.f64, v: ti.f64, zero: ti.i32) -> ti.f64:
    """Return the same, but add the terms first that are equal along a row of the result."""
    shared = wide_product(h[3 * row + 1], v, zero) + h[3 * row + 2]
    return wide_product(h[3 * row], u, zero) + shared


@ti.func
def _placed(x: ti.f64) -> ti.f64:
    """Round a coordinate to 2^-23: first, beside a large number, to 2^-32."""
    found = x
    if abs(x) < WIDEST:
        # Both parts of START are exact as float32, which Taichi makes of constants.
        start = ti.cast(MIDDLE, ti.f64) + ti.cast(START - MIDDLE, ti.f64)
        steps = whole((x + start) * ti.cast(2.0**PLACE_BITS, ti.f64))
        found = steps * ti.cast(2.0**-PLACE_BITS, ti.f64) - MIDDLE
    return found


@ti.func
def _in_steps(
    src: ti.template(),
    p: ti.i32,
    c: ti.i32,
    y: ti.f64,
    x: ti.f64,
    border: ti.i32,
    zero: ti.i32,
) -> ti.i32:
    """Weigh the pixels of one channel by whole numbers whose sum is 2^23, and round the mean."""
    top = first_tap(y, 1)
    left = first_tap(x, 1)
    across = ti.cast(weights(x, 1, zero)[1] * float(2**PLACE_BITS), ti.i32)
    down = ti.cast(weights(y, 1, zero)[1] * float(2**PLACE_BITS), ti.i32)
    both = ti.cast((ti.cast(across, ti.i64) * ti.cast(down, ti.i64)) >> PLACE_BITS, ti.i32)
    share = ti.Vector([2**PLACE_BITS - across - down + both, across - both, down - both, both])
    total = 2 ** (PLACE_BITS - 1)
    for n in ti.static(range(4)):
        i = tap_index(top + n // 2, src.shape[1], border)
        j = tap_index(left + n % 2, src.shape[2], border)
        total += share[n] * ti.cast(src[p, i, j, c], ti.i32)
    return total >> PLACE_BITS


@ti.kernel
def _warp(
    src: any_4,  # (P, H, W, C)
    inverse: f64_1,  # (9,), acts on (x, y, 1) of the result
    order: ti.template(),
    rounded: ti.template(),
    steps: ti.template(),
    border: ti.i32,
    cval: ti.f32,
    margin: ti.i32,
    zero: ti.i32,
    # outputs
    dst: any_4,  # (P, H', W', C)
):
    for i, j in ti.ndrange(dst.shape[1], dst.shape[2]):
        u = ti.cast(j, ti.f64)
        v = ti.cast(i, ti.f64)
        at_x = ti.cast(0, ti.f64)
        at_y = ti.cast(0, ti.f64)
        if ti.static(steps):
            r = 1.0 / _of_row(inverse, 2, u, v, zero)
            at_x = _placed(wide_product(_of_row(inverse, 0, u, v, zero), r, zero))
            at_y = _placed(wide_product(_of_row(inverse, 1, u, v, zero), r, zero))
        else:
            w = _combined(inverse, 2, u, v, zero)
            shift = ti.cast(margin, ti.f64)
            at_x = _combined(inverse, 0, u, v, zero) / w + shift
            at_y = _combined(inverse, 1, u, v, zero) / w + shift
        y, _ = mapped(at_y, src.shape[1], border, zero)
        x, _ = mapped(at_x, src.shape[2], border, zero)
        for p in range(dst.shape[0]):
            for c in range(dst.shape[3]):
                value = cval
                if y != OUTSIDE and x != OUTSIDE:
                    if ti.static(steps):
                        value = ti.cast(_in_steps(src, p, c, y, x, border, zero), ti.f32)
                    else:
                        value = sample(src, p, c, y, x, order, border, zero)
                if ti.static(rounded):
                    dst[p, i, j, c] = ti.cast(stored(value), ti.u8)
                else:
                    dst[p, i, j, c] = value
