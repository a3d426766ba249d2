"""Demosaicing by fixed filters, in Taichi.

A missing colour is the mean of its nearest samples (bilinear), and for Malvar's filters a share of
the difference is added between the measured colour and the mean of its own neighbours [Malvar, He
and Cutler 2004]. All weights are sixteenths, so that sums of integers up to 2^16 are exact.
Integers are rounded half up. One thread takes a pixel.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.raw import Linear
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._rounding import product
from cvkern.kernels.taichi.raw._mirror import mirror
from cvkern.kernels.taichi.raw.demosaicing._samples import highest, rounded

any_2 = ti.types.ndarray(ndim=2)  # u8, u16 or f32
any_3 = ti.types.ndarray(ndim=3)

MALVAR = int(Linear.MALVAR)


@ti.kernel
def _interpolate(
    raw: any_2,
    red_row: ti.i32,
    red_column: ti.i32,
    method: ti.i32,
    highest: ti.f32,
    zero: ti.i32,
    # outputs
    colours: any_3,
):
    for y, x in raw:
        near = ti.Matrix.zero(ti.f32, 5, 5)
        for i, j in ti.static(ti.ndrange(5, 5)):
            u, v = mirror(y + i - 2, raw.shape[0]), mirror(x + j - 2, raw.shape[1])
            near[i, j] = ti.cast(raw[u, v], ti.f32)
        c = near[2, 2]
        h = near[2, 1] + near[2, 3]
        v = near[1, 2] + near[3, 2]
        d = (near[1, 1] + near[1, 3]) + (near[3, 1] + near[3, 3])
        far_h = near[2, 0] + near[2, 4]
        far_v = near[0, 2] + near[4, 2]
        cross, across, down, corners = 0.25 * (h + v), 0.5 * h, 0.5 * v, 0.25 * d
        if method == MALVAR:
            five = product(5.0, c, zero)
            cross = 0.125 * ((4.0 * c + 2.0 * (h + v)) - (far_h + far_v))
            across = 0.125 * (((five + 4.0 * h) - (d + far_h)) + 0.5 * far_v)
            down = 0.125 * (((five + 4.0 * v) - (d + far_v)) + 0.5 * far_h)
            corners = 0.125 * (
                (product(6.0, c, zero) + 2.0 * d) - product(1.5, far_h + far_v, zero)
            )
        blue = ti.cast((y & 1) != red_row, ti.i32)
        chroma = (x & 1) == (red_column ^ blue)
        own, green, other = across, c, down
        if chroma:
            own, green, other = c, cross, corners
        values = ti.Vector([own, green, other])
        if blue == 1:
            values = ti.Vector([other, green, own])
        for k in ti.static(range(3)):
            colours[y, x, k] = rounded(values[k], highest)


@primitive
def interpolate(
    raw: np.ndarray, red_row: int, red_column: int, method: int, colours: np.ndarray
) -> None:
    """Fill in the two colours that each pixel misses; one thread a pixel."""
    _interpolate(raw, red_row, red_column, method, highest(raw), 0, colours)
