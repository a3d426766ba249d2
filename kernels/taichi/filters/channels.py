"""Channels of colour images, in Taichi; one thread per pixel.

The gradient of a colour image at a pixel is that of the channel where it is longest; of equal ones,
the first channel's (as in cv2.Canny).
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.edges import Norm
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._polar import squared_magnitude

any_3 = ti.types.ndarray(ndim=3)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)


@ti.kernel
def _split(
    src: any_3,
    # outputs
    planes: any_3,
):
    for y, x in ti.ndrange(planes.shape[1], planes.shape[2]):
        for c in range(planes.shape[0]):
            planes[c, y, x] = src[y, x, c]


@primitive
def split(src: np.ndarray, planes: np.ndarray) -> None:
    """Copy the first channels of an image, uint8 or float32, to planes; one thread per pixel."""
    _split(src, planes)


@ti.func
def _length(dy: ti.f32, dx: ti.f32, norm: ti.i32, zero: ti.i32) -> ti.f32:
    """Return the length of a gradient, or its square."""
    length = ti.abs(dx) + ti.abs(dy)
    if norm == int(Norm.L2):
        length = squared_magnitude(dy, dx, zero)
    return length


@ti.kernel
def _longest(
    dys: f32_3,
    dxs: f32_3,
    norm: ti.i32,
    zero: ti.i32,
    # outputs
    dy: f32_2,
    dx: f32_2,
):
    for y, x in dy:
        best = 0
        most = _length(dys[0, y, x], dxs[0, y, x], norm, zero)
        for c in range(1, dys.shape[0]):
            length = _length(dys[c, y, x], dxs[c, y, x], norm, zero)
            if length > most:
                most = length
                best = c
        dy[y, x] = dys[best, y, x]
        dx[y, x] = dxs[best, y, x]


@primitive
def longest(dys: np.ndarray, dxs: np.ndarray, norm: int, dy: np.ndarray, dx: np.ndarray) -> None:
    """Take each pixel's gradient from the channel where it is longest, the first of equal ones."""
    _longest(dys, dxs, norm, 0, dy, dx)
