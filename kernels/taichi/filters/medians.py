"""Rank filters in Taichi; one thread per element.

The value of rank r is the largest v with at most r window values below v. It is found bit by bit,
from the highest bit. Floats are compared as integers: by their bits, in reversed order for negative
ones.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._borders import border_index
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._order import ordered

i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
any_3 = ti.types.ndarray(ndim=3)  # u8 or i32


@ti.kernel
def _median(
    src: any_3,  # (planes, rows, columns * step)
    radius: ti.i32,
    step: ti.i32,
    low: ti.i32,
    bits: ti.i32,
    border: ti.i32,
    cval: ti.i32,
    # outputs
    dst: any_3,
):
    for p, y, i in dst:
        x = i // step
        rank = 2 * radius * (radius + 1)  # ((2 radius + 1)^2 - 1) / 2
        # Find the largest value with at most `rank` smaller ones in the window, from its highest
        # bit. With 32 bits and low = -2^31 the first sum wraps to 0, which is correct.
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
                        v = ti.cast(src[p, jy, i + (jx - x) * step], ti.i32)
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
    """Find the median of each window of uint8 or int32 by bisection; one thread per element."""
    _median(src, radius, step, low, bits, border, cval, dst)


@ti.kernel
def _keys_of_floats(
    bits: i32_1,
    # outputs
    keys: i32_1,
):
    for i in bits:
        b = bits[i]
        if (b & 0x7FFFFFFF) > 0x7F800000:  # a NaN of any sign is placed above infinity
            b = 0x7FC00000
        keys[i] = ordered(b)


@primitive
def keys_of_floats(bits: np.ndarray, keys: np.ndarray) -> None:
    """Convert bits of floats to integers of the same order: invert negative ones below the sign."""
    _keys_of_floats(bits.reshape(-1), keys.reshape(-1))


@ti.kernel
def _floats_of_keys(
    keys: i32_1,
    # outputs
    bits: i32_1,
):
    for i in keys:
        bits[i] = ordered(keys[i])


@primitive
def floats_of_keys(keys: np.ndarray, bits: np.ndarray) -> None:
    """Undo `keys_of_floats`."""
    _floats_of_keys(keys.reshape(-1), bits.reshape(-1))
