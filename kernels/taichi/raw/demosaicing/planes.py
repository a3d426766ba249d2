"""Copies between images and extended planes of floats, in Taichi.

Planes have MARGIN more pixels on each side. These mirror the image at its outermost samples, and
so keep the colours of the mosaic. One thread takes a pixel.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.raw import MARGIN
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi.raw._mirror import mirror
from cvkern.kernels.taichi.raw.demosaicing._samples import highest, rounded

any_2 = ti.types.ndarray(ndim=2)  # u8, u16 or f32
any_3 = ti.types.ndarray(ndim=3)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)


@ti.kernel
def _extend(raw: any_2, top: ti.i32, planes: f32_3):
    for y, x in ti.ndrange(planes.shape[1], planes.shape[2]):
        u = mirror(top + y - MARGIN, raw.shape[0])
        v = mirror(x - MARGIN, raw.shape[1])
        planes[0, y, x] = ti.cast(raw[u, v], ti.f32)


@primitive
def extend(raw: np.ndarray, top: int, planes: np.ndarray) -> None:
    """Copy the rows from `top` on to the first plane, and `MARGIN` mirrored pixels around them.

    One thread a pixel.
    """
    _extend(raw, top, planes)


@ti.kernel
def _join(
    planes: f32_3,
    red: ti.i32,
    green: ti.i32,
    blue: ti.i32,
    top: ti.i32,
    rows: ti.i32,
    most: ti.f32,
    # outputs
    colours: any_3,
):
    for y, x in ti.ndrange(rows, colours.shape[1]):
        u, v = y + MARGIN, x + MARGIN
        colours[top + y, x, 0] = rounded(planes[red, u, v], most)
        colours[top + y, x, 1] = rounded(planes[green, u, v], most)
        colours[top + y, x, 2] = rounded(planes[blue, u, v], most)


@primitive
def join(
    planes: np.ndarray, red: int, green: int, blue: int, top: int, rows: int, colours: np.ndarray
) -> None:
    """Round three planes, without their margins, to `rows` rows of colours from `top` on.

    One thread a pixel.
    """
    _join(planes, red, green, blue, top, rows, highest(colours), colours)
