"""Extrema between the pixels and levels of a scale space, in Taichi.

With the gradient g and the Hessian H of the differences D at an extremum, the paraboloid
``D + g . x + x . H x / 2`` has its own extremum at ``x = -H^-1 g``, of the height
``D + g . x / 2``. If x is farther than half a pixel away, the fit moves to the next pixel, and
repeats a few times. A point is kept if its height is large enough, and if it is not an edge:
``tr^2 / det`` of the Hessian in the image is below a limit [D. G. Lowe, IJCV 60(2), 2004]. The
arithmetic is in float64; one thread takes a point.
"""

from collections.abc import Sequence

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive

from ._paraboloid import fit

i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)


@primitive
def refine(
    octaves: Sequence[np.ndarray],
    contrast: float,
    edge: float,
    margin: int,
    offsets: np.ndarray,
    cells: np.ndarray,
) -> None:
    """Fit a paraboloid to each extremum, and move it to where that has its own; a thread each.

    `cells` holds octave, level, row and column before and afterwards; the octave of an extremum
    that is not kept becomes -1.
    """
    for o, levels in enumerate(octaves):
        _fit(levels, o, contrast, edge, margin, 0, offsets, cells)


@ti.kernel
def _fit(
    levels: f32_3,  # (L, H, W)
    octave: ti.i32,
    contrast: ti.f32,  # least height
    edge: ti.f32,  # largest tr^2 / det
    margin: ti.i32,
    zero: ti.i32,
    # outputs
    offsets: f32_2,  # (N, 4): row, column, level, height
    # in place
    cells: i32_2,  # (N, 4): octave, level, row, column
):
    for n in range(cells.shape[0]):
        if cells[n, 0] == octave:
            end = fit(levels, cells[n, 1], cells[n, 2], cells[n, 3], contrast, edge, margin, zero)
            offsets[n, 0] = ti.cast(end.oy, ti.f32)
            offsets[n, 1] = ti.cast(end.ox, ti.f32)
            offsets[n, 2] = ti.cast(end.os, ti.f32)
            offsets[n, 3] = ti.cast(end.top, ti.f32)
            if end.kept == 0:
                cells[n, 0] = -1
            cells[n, 1] = end.s
            cells[n, 2] = end.y
            cells[n, 3] = end.x
