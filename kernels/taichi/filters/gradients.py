"""Gradients, their lengths and angles, in Taichi; one thread per element.

A derivative is a difference in one direction and a smoothing in the other. The length is
``sqrt(dx^2 + dy^2)``. A polynomial gives the angle of (dx, dy), because the arc tangents of devices
differ.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.filters import Outside
from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi._polar import gradient_angle, squared_magnitude
from cvkern.kernels.taichi._rounding import root

from ._separable import correlate_along, correlate_down

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
u8_3 = ti.types.ndarray(dtype=ti.u8, ndim=3)


@primitive
def differentiate(
    src: np.ndarray,
    smooth: np.ndarray,
    slope: np.ndarray,
    outside: Outside,
    dy: np.ndarray,
    dx: np.ndarray,
) -> None:
    """Correlate with slope down the rows and smooth along the columns (dy), or exchanged (dx)."""
    planes = (1, *src.shape)[-3:]
    border, cval, cval_smooth, cval_slope = outside
    down = scratch(planes, np.float32)
    correlate_down(src.reshape(planes), slope, border, cval, 0, down)
    correlate_along(down, smooth, 1, border, cval_slope, 0, dy.reshape(planes))
    correlate_down(src.reshape(planes), smooth, border, cval, 0, down)
    correlate_along(down, slope, 1, border, cval_smooth, 0, dx.reshape(planes))


@ti.kernel
def _polar(
    dy: f32_1,
    dx: f32_1,
    zero: ti.i32,
    # outputs
    magnitude: f32_1,
    orientation: f32_1,
):
    for i in dy:
        magnitude[i] = root(squared_magnitude(dy[i], dx[i], zero), zero)
        orientation[i] = gradient_angle(dy[i], dx[i], zero)


@primitive
def polar(dy: np.ndarray, dx: np.ndarray, magnitude: np.ndarray, orientation: np.ndarray) -> None:
    """Compute the length and the angle of each (dy, dx)."""
    _polar(dy.reshape(-1), dx.reshape(-1), 0, magnitude.reshape(-1), orientation.reshape(-1))


@primitive
def differentiate_polar(
    src: np.ndarray,
    smooth: np.ndarray,
    slope: np.ndarray,
    outside: Outside,
    dy: np.ndarray,
    dx: np.ndarray,
    magnitude: np.ndarray,
    orientation: np.ndarray,
) -> None:
    """Differentiate, and compute the length and the angle of each (dy, dx) as well."""
    differentiate(src, smooth, slope, outside, dy, dx)
    polar(dy, dx, magnitude, orientation)


@ti.kernel
def _root_mean_square(
    dy: f32_1,
    dx: f32_1,
    zero: ti.i32,
    # outputs
    dst: f32_1,
):
    for i in dy:
        dst[i] = root(squared_magnitude(dy[i], dx[i], zero) * 0.5, zero)


@primitive
def root_mean_square(dy: np.ndarray, dx: np.ndarray, dst: np.ndarray) -> None:
    """Compute ``sqrt((dy^2 + dx^2) / 2)`` of each pair."""
    _root_mean_square(dy.reshape(-1), dx.reshape(-1), 0, dst.reshape(-1))


@ti.kernel
def _add(
    dy: f32_1,
    dx: f32_1,
    # outputs
    dst: f32_1,
):
    for i in dy:
        dst[i] = dy[i] + dx[i]


@primitive
def add(dy: np.ndarray, dx: np.ndarray, dst: np.ndarray) -> None:
    """Compute ``dy + dx`` of each pair."""
    _add(dy.reshape(-1), dx.reshape(-1), dst.reshape(-1))


@ti.kernel
def _confine(
    mask: u8_3,
    # outputs
    dst: f32_3,
):
    for n, y, x in dst:
        whole = 0 < y < dst.shape[1] - 1 and 0 < x < dst.shape[2] - 1
        if whole:
            for below, beside in ti.static(ti.ndrange((-1, 2), (-1, 2))):
                if mask[n, y + below, x + beside] == 0:
                    whole = False
        if not whole:
            dst[n, y, x] = 0.0


@primitive
def confine(mask: np.ndarray, dst: np.ndarray) -> None:
    """Set pixels to 0 where they or one of their eight neighbours are masked or outside."""
    planes = (1, *dst.shape)[-3:]
    _confine(mask.reshape(planes), dst.reshape(planes))
