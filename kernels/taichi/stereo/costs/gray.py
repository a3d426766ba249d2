"""Grey values of 8 bits, which stereo matching compares, in Taichi."""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._rounding import product

any_3 = ti.types.ndarray(ndim=3)  # u8 or f32
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)


@ti.func
def _byte(value: ti.f32, scale: ti.f32, zero: ti.i32) -> ti.i32:
    """Return the nearest integer in [0, 255]; 0 for NaN."""
    v = product(value, scale, zero)
    byte = 0
    # Detect NaN by its bits, because the CUDA compiler assumes that there is none.
    if (ti.bit_cast(v, ti.i32) & 0x7FFFFFFF) <= 0x7F800000:
        if v >= 255.0:
            byte = 255
        elif v > 0.0:
            byte = ti.cast(v + 0.5, ti.i32)
    return byte


@ti.kernel
def _gray_bytes(
    image: any_3,  # (H, W, C)
    scale: ti.f32,
    zero: ti.i32,
    # outputs
    gray: u8_2,
):
    for y, x in gray:
        value = _byte(ti.cast(image[y, x, 0], ti.f32), scale, zero)
        if image.shape[2] > 1:
            green = _byte(ti.cast(image[y, x, 1], ti.f32), scale, zero)
            blue = _byte(ti.cast(image[y, x, 2], ti.f32), scale, zero)
            value = (77 * value + 150 * green + 29 * blue + 128) >> 8
        gray[y, x] = ti.cast(value, ti.u8)


@primitive
def gray_bytes(image: np.ndarray, scale: float, gray: np.ndarray) -> None:
    """Convert an image of 1, or of 3 or more channels, to grey values of 8 bits.

    uint8 values are used unchanged. float32 values are multiplied by `scale`, rounded, and clipped
    to [0, 255]. The first three channels are red, green and blue. One thread per pixel.
    """
    _gray_bytes(image, 1.0 if image.dtype == np.uint8 else scale, 0, gray)
