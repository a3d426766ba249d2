"""Images seen through a homography, in Taichi: the map and the sample in one kernel.

Pixel q = (x, y, 1) of the result shows the place ``p ~ H^-1 q`` of the image, sampled with a spline
of order 0, 1 or 3 (_taps.py). The map is in float64. One thread takes a pixel.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.transform import OUTSIDE
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._rounding import wide_product

from ._taps import mapped, sample, stored

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
    _warp(src, inverse, order, dst.dtype == np.uint8, border, cval, margin, 0, dst)


@ti.func
def _combined(h: ti.template(), row: ti.i32, u: ti.f64, v: ti.f64, zero: ti.i32) -> ti.f64:
    """Return one row of the matrix times (u, v, 1)."""
    a = wide_product(h[3 * row], u, zero)
    return a + wide_product(h[3 * row + 1], v, zero) + h[3 * row + 2]


@ti.kernel
def _warp(
    src: any_4,  # (P, H, W, C)
    inverse: f64_1,  # (9,), acts on (x, y, 1) of the result
    order: ti.template(),
    rounded: ti.template(),
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
                    value = sample(src, p, c, y, x, order, border, zero)
                if ti.static(rounded):
                    dst[p, i, j, c] = ti.cast(stored(value), ti.u8)
                else:
                    dst[p, i, j, c] = value
