"""Normalised patches of an image, in Taichi: integers throughout."""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.recognition import LARGEST, SPREAD, WHITE
from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi._rounding import product

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
i8_2 = ti.types.ndarray(dtype=ti.i8, ndim=2)


@primitive
def sample_patches(
    image: np.ndarray, corners: np.ndarray, side: int, least: int, patches: np.ndarray
) -> None:
    """Cut out patches and normalise them: mean 0, standard deviation `SPREAD`; a thread a patch.

    `image` (P,) has the pixels of all levels behind one another; `corners` (N, 2) are the first
    pixel of each patch and the length of its rows. Pixels between 0 and 1 are rounded to integers
    between 0 and `WHITE`. Deviations are (n x - sum x) / R for n pixels, with
    R^2 = n sum x^2 - (sum x)^2, halves rounded up. A patch with R < `least` is 0, and so is what
    is behind its pixels.
    """
    pixels = scratch(image.shape, np.int32)
    _round(image, 0, pixels)
    _sample(pixels, corners, side, least, patches)


@ti.kernel
def _round(
    image: f32_1,
    zero: ti.i32,
    # outputs
    pixels: i32_1,
):
    for i in pixels:
        value = ti.min(ti.max(image[i], 0.0), 1.0)
        pixels[i] = ti.cast(ti.floor(product(value, WHITE, zero) + 0.5), ti.i32)


@ti.func
def _root(square: ti.i64) -> ti.i64:
    """Return the largest integer whose square is not larger."""
    root = ti.cast(ti.sqrt(ti.cast(square, ti.f64)), ti.i64)
    while root * root > square:
        root -= 1
    while (root + 1) * (root + 1) <= square:
        root += 1
    return root


@ti.kernel
def _sample(
    pixels: i32_1,  # (P,)
    corners: i32_2,  # (N, 2)
    side: ti.i32,
    least: ti.i64,
    # outputs
    patches: i8_2,  # (N, D)
):
    for i in range(corners.shape[0]):
        first = corners[i, 0]
        width = corners[i, 1]
        count = side * side
        total = ti.cast(0, ti.i64)
        squares = ti.cast(0, ti.i64)
        for k in range(count):
            x = ti.cast(pixels[first + k // side * width + k % side], ti.i64)
            total += x
            squares += x * x
        root = _root(count * squares - total * total)
        for k in range(patches.shape[1]):
            value = ti.cast(0, ti.i64)
            if k < count and root >= least:
                x = ti.cast(pixels[first + k // side * width + k % side], ti.i64)
                # The sum is positive, where every division rounds alike.
                above = 2 * SPREAD * (count * x - total) + root + 2 * root * 4096
                value = above // (2 * root) - 4096
            value = ti.min(ti.max(value, -LARGEST), LARGEST)
            patches[i, k] = ti.cast(value, ti.i8)
