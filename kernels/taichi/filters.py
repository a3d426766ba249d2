"""Linear and rank filters in Taichi."""

import numpy as np
import taichi as ti

from ._borders import border_index
from ._gradients import gradient_angle, squared_magnitude
from ._launch import primitive, scratch
from ._rounding import product, root

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
i32_3 = ti.types.ndarray(dtype=ti.i32, ndim=3)


@ti.kernel
def _correlate_down(
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
def _correlate_along(
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


@primitive
def correlate_separable(
    src: np.ndarray,
    taps_y: np.ndarray,
    taps_x: np.ndarray,
    step: int,
    border: int,
    cval: float,
    dst: np.ndarray,
) -> None:
    """Correlate down the rows, then along the columns; one thread per element and pass."""
    down = scratch(src.shape, np.float32)
    _correlate_down(src, taps_y, border, cval, 0, down)
    _correlate_along(down, taps_x, step, border, cval, 0, dst)


@ti.kernel
def _polar(
    dy: f32_2,
    dx: f32_2,
    zero: ti.i32,
    # outputs
    magnitude: f32_2,
    orientation: f32_2,
):
    for y, x in dy:
        magnitude[y, x] = root(squared_magnitude(dy[y, x], dx[y, x], zero))
        orientation[y, x] = gradient_angle(dy[y, x], dx[y, x], zero)


@primitive
def polar(dy: np.ndarray, dx: np.ndarray, magnitude: np.ndarray, orientation: np.ndarray) -> None:
    """Turn gradients into length and angle; one thread per pixel."""
    _polar(dy, dx, 0, magnitude, orientation)


@ti.kernel
def _median(
    src: i32_3,  # (planes, rows, columns * step)
    radius: ti.i32,
    step: ti.i32,
    low: ti.i32,
    bits: ti.i32,
    border: ti.i32,
    cval: ti.i32,
    # outputs
    dst: i32_3,
):
    for p, y, i in dst:
        x = i // step
        rank = 2 * radius * (radius + 1)  # ((2 radius + 1)^2 - 1) / 2
        # The median is the largest value with at most `rank` smaller ones in the window: its bits
        # from the highest. With 32 bits and low = -2^31 the first sum wraps to 0, which is right.
        value = low
        for b in range(bits):
            middle = value + (1 << (bits - 1 - b))
            smaller = 0
            for ty in range(-radius, radius + 1):
                jy = border_index(y + ty, src.shape[1], border)
                for tx in range(-radius, radius + 1):
                    jx = border_index(x + tx, src.shape[2] // step, border)
                    v = cval
                    if jy >= 0 and jx >= 0:
                        v = src[p, jy, i + (jx - x) * step]
                    if v < middle:
                        smaller += 1
            if smaller <= rank:
                value = middle
        dst[p, y, i] = value


@primitive
def median(
    src: np.ndarray,
    radius: int,
    step: int,
    low: int,
    bits: int,
    border: int,
    cval: int,
    dst: np.ndarray,
) -> None:
    """Take the median of each square window by bisection of its value; one thread per element."""
    _median(src, radius, step, low, bits, border, cval, dst)
