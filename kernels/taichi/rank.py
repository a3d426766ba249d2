"""Rank filters in Taichi."""

import numpy as np
import taichi as ti

from ._borders import border_index
from ._launch import primitive

i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_3 = ti.types.ndarray(dtype=ti.i32, ndim=3)


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


@ti.kernel
def _turn_negative(
    src: i32_1,
    # outputs
    dst: i32_1,
):
    for i in src:
        v = src[i]
        dst[i] = v ^ 0x7FFFFFFF if v < 0 else v


@primitive
def turn_negative(src: np.ndarray, dst: np.ndarray) -> None:
    """Turn round the bits below the sign of negative integers; one thread per element."""
    _turn_negative(src.reshape(-1), dst.reshape(-1))
