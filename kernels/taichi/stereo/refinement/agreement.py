"""The check of a disparity map against that of the right image, in Taichi.

A disparity d of pixel (y, x) is kept where abs(d - right[y, x - floor(d + 0.5)]) is at most the
tolerance. One thread per pixel.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive

from ._bits import is_finite, none

any_2 = ti.types.ndarray(ndim=2)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)


@ti.kernel
def _left_right(
    disparity: f32_2,
    right: any_2,  # f32 disparities, or i32 indices
    first: ti.i32,
    indices: ti.i32,  # whether these are indices
    tolerance: ti.f32,
    # outputs
    checked: f32_2,
):
    width = ti.cast(disparity.shape[1], ti.f32)
    for y, x in checked:
        d = disparity[y, x]
        kept = none()
        if is_finite(d):
            at = ti.cast(x, ti.f32) - ti.floor(d + 0.5)
            if 0.0 <= at < width:
                match = right[y, ti.cast(at, ti.i32)]
                other = ti.cast(match, ti.f32)
                exists = is_finite(other)
                if indices == 1:
                    exists = match >= 0
                    other = ti.cast(first + ti.cast(match, ti.i32), ti.f32)
                if exists:
                    if ti.abs(d - other) <= tolerance:
                        kept = d
        checked[y, x] = kept


@primitive
def left_right(
    disparity: np.ndarray, right: np.ndarray, first: int, tolerance: float, checked: np.ndarray
) -> None:
    """Keep the disparities with which the right image agrees; one thread per pixel.

    `right` holds float32 disparities, or int32 indices of disparities that begin at `first`,
    negative where there is none.
    """
    _left_right(disparity, right, first, right.dtype == np.int32, tolerance, checked)
