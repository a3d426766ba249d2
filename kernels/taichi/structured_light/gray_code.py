"""Decoding of Gray codes in photographs of a projector's patterns, in Taichi.

Frames come in pairs: a pattern and its inverse, the highest bit first. Bit b of the Gray code g is
1 where the pattern is the brighter of the two, and the binary code is its running parity:
``code_b = g_(n-1) xor ... xor g_b`` [Gray 1953, US patent 2632058]. A code is valid if every pair
differs by more than `margin`, and if the pixel is brighter under white light than under black by
more than `contrast`. One thread decodes one pixel.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.structured_light import NONE
from cvkern.kernels.taichi._launch import primitive

any_2 = ti.types.ndarray(ndim=2)  # u8, u16 or f32
any_3 = ti.types.ndarray(ndim=3)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)


@ti.kernel
def _decode(
    frames: any_3,  # (K, H, W)
    begin: ti.i32,
    bits: ti.i32,
    size: ti.i32,
    margin: ti.f32,
    joins: ti.i32,
    # outputs
    codes: i32_2,
    valid: u8_2,
):
    for y, x in codes:
        code = 0
        bit = 0
        clear = True
        for k in range(bits):
            pattern = ti.cast(frames[begin + 2 * k, y, x], ti.f32)
            inverse = ti.cast(frames[begin + 2 * k + 1, y, x], ti.f32)
            bit ^= ti.cast(pattern > inverse, ti.i32)
            code = 2 * code + bit
            clear = clear and ti.abs(pattern - inverse) > margin
        known = clear and code < size
        codes[y, x] = code if known else NONE
        valid[y, x] = ti.cast(known and (joins == 0 or valid[y, x] != 0), ti.u8)


@primitive
def decode(
    frames: np.ndarray,
    begin: int,
    bits: int,
    size: int,
    margin: float,
    joins: bool,
    codes: np.ndarray,
    valid: np.ndarray,
) -> None:
    """Decode the pairs of frames, from `begin` on, of an axis of `size` lines; a thread a pixel.

    `valid` tells which pixels have a code; with `joins`, only those that were valid before.
    """
    _decode(frames, begin, bits, size, margin, joins, codes, valid)


@ti.kernel
def _accept(
    white: any_2,  # (H, W)
    black: any_2,
    contrast: ti.f32,
    # outputs
    valid: u8_2,
):
    for y, x in valid:
        lit = ti.cast(white[y, x], ti.f32) - ti.cast(black[y, x], ti.f32) > contrast
        valid[y, x] = ti.cast(lit and valid[y, x] != 0, ti.u8)


@primitive
def accept(white: np.ndarray, black: np.ndarray, contrast: float, valid: np.ndarray) -> None:
    """Clear the pixels without enough light; one thread a pixel."""
    _accept(white, black, contrast, valid)


@ti.kernel
def _spreads(
    frames: any_3,  # (K, H, W)
    begin: ti.i32,
    step: ti.i32,
    # outputs
    spreads: f32_2,  # (samples, bits - 1)
):
    across = (frames.shape[2] + step - 1) // step
    for i, k in spreads:
        y = i // across * step
        x = i % across * step
        first = ti.cast(frames[begin + 2 * k, y, x], ti.f32) + ti.cast(
            frames[begin + 2 * k + 1, y, x], ti.f32
        )
        second = ti.cast(frames[begin + 2 * k + 2, y, x], ti.f32) + ti.cast(
            frames[begin + 2 * k + 3, y, x], ti.f32
        )
        spreads[i, k] = ti.abs(second - first)


@primitive
def spreads(frames: np.ndarray, begin: int, step: int, spreads: np.ndarray) -> None:
    """Compare the sums of consecutive pairs, at every `step`-th pixel down and across.

    A pattern and its inverse add up to the same light, so that the sums differ by noise alone.
    """
    _spreads(frames, begin, step, spreads)
