"""Smoothing that ignores masked pixels, in Taichi; one thread per pixel.

The smoothed image s of the unmasked pixels is divided by their smoothed weights w. The derivative
of this quotient is (s / w)' = (s' - s / w w') / w.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi._rounding import product, quotient

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)
u8_3 = ti.types.ndarray(dtype=ti.u8, ndim=3)


@ti.kernel
def _cover(
    image: f32_2,
    masked: ti.i32,
    mask: u8_2,
    # outputs
    covered: f32_2,
    weight: f32_2,
):
    for y, x in image:
        there = 1
        if masked != 0:
            if mask[y, x] == 0:
                there = 0
        covered[y, x] = image[y, x] if there != 0 else 0.0
        weight[y, x] = 1.0 if there != 0 else 0.0


@primitive
def cover(
    image: np.ndarray, mask: np.ndarray | None, covered: np.ndarray, weight: np.ndarray
) -> None:
    """Set masked pixels, if any, to 0, and write the weights 1 and, for masked pixels, 0."""
    tall = -1, image.shape[-1]  # the rows of all images of a stack
    given = scratch((1, 1), np.uint8) if mask is None else mask.reshape(tall)
    outputs = covered.reshape(tall), weight.reshape(tall)
    _cover(image.reshape(tall), int(mask is not None), given, *outputs)


@ti.kernel
def _recover(
    weight: f32_2,
    least: ti.f32,
    zero: ti.i32,
    # outputs
    image: f32_2,
):
    for y, x in image:
        image[y, x] = quotient(image[y, x], weight[y, x] + least, zero)


@primitive
def recover(weight: np.ndarray, least: float, image: np.ndarray) -> None:
    """Divide smoothed pixels by the smoothed weight; one thread per pixel."""
    tall = -1, image.shape[-1]
    _recover(weight.reshape(tall), least, 0, image.reshape(tall))


@ti.kernel
def _recover_frame(
    rows: f32_1,
    columns: f32_1,
    cval: ti.f32,
    zero: ti.i32,
    # outputs
    image: f32_2,
):
    for y, x in image:
        row = rows[y % rows.shape[0]]
        if row != 1.0 or columns[x] != 1.0:
            beyond = product(cval, 1.0 - columns[x], zero)
            share = product(row, columns[x], zero) + beyond
            image[y, x] = quotient(image[y, x], share, zero)


@primitive
def recover_frame(
    rows: np.ndarray, columns: np.ndarray, cval: float, reach: int, image: np.ndarray
) -> None:
    """Divide pixels near the border by their weight; one thread per pixel; `reach` is not used."""
    _recover_frame(rows, columns, cval, 0, image.reshape((-1, image.shape[-1])))


@ti.kernel
def _recover_slopes(
    smooth: f32_2,
    weight: f32_2,
    weight_dy: f32_2,
    weight_dx: f32_2,
    least: ti.f32,
    zero: ti.i32,
    # outputs
    dy: f32_2,
    dx: f32_2,
):
    for y, x in dy:
        share = weight[y, x] + least
        level = quotient(smooth[y, x], share, zero)
        dy[y, x] = quotient(dy[y, x] - product(level, weight_dy[y, x], zero), share, zero)
        dx[y, x] = quotient(dx[y, x] - product(level, weight_dx[y, x], zero), share, zero)


@primitive
def recover_slopes(
    smooth: np.ndarray,
    weight: np.ndarray,
    weight_dy: np.ndarray,
    weight_dx: np.ndarray,
    least: float,
    dy: np.ndarray,
    dx: np.ndarray,
) -> None:
    """Differentiate a quotient, (s / w)' = (s' - s / w w') / w; one thread per pixel."""
    tall = -1, dy.shape[-1]
    given = (a.reshape(tall) for a in (smooth, weight, weight_dy, weight_dx))
    _recover_slopes(*given, least, 0, dy.reshape(tall), dx.reshape(tall))


@ti.kernel
def _confine(
    mask: u8_3,
    # outputs
    states: u8_3,
):
    for n, y, x in states:
        whole = 0 < y < states.shape[1] - 1 and 0 < x < states.shape[2] - 1
        if whole:
            for below, beside in ti.static(ti.ndrange((-1, 2), (-1, 2))):
                if mask[n, y + below, x + beside] == 0:
                    whole = False
        if not whole:
            states[n, y, x] = ti.cast(0, ti.u8)


@primitive
def confine(mask: np.ndarray, states: np.ndarray) -> None:
    """Remove edges where a pixel or one of its eight neighbours is masked; one thread per pixel."""
    planes = (1, *states.shape)[-3:]
    _confine(mask.reshape(planes), states.reshape(planes))
