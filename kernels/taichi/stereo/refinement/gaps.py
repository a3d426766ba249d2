"""Filling of gaps of a disparity map from the background, in Taichi.

A gap takes the smaller of the two disparities that bound it along its row, because it shows
background that only the left camera sees. One thread per row.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive, scratch

from ._bits import is_finite, none

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)


@ti.kernel
def _fill(
    disparity: f32_2,
    # outputs
    filled: f32_2,
    valid: u8_2,
    found: i32_1,
):
    width = disparity.shape[1]
    for y in range(disparity.shape[0]):
        begin = width  # the first column with a disparity
        nearest = 0.0
        for x in range(width):
            here = is_finite(disparity[y, x])
            if here:
                nearest = disparity[y, x]
                begin = ti.min(begin, x)
            valid[y, x] = ti.cast(here, ti.u8)
            filled[y, x] = nearest
        found[y] = ti.cast(begin < width, ti.i32)
        behind = 0  # whether there is a disparity behind x
        for i in range(width):
            x = width - 1 - i
            if valid[y, x] == 1:
                nearest = disparity[y, x]
                behind = 1
            if x < begin:
                filled[y, x] = nearest
            elif behind == 1:
                filled[y, x] = ti.min(filled[y, x], nearest)


@ti.kernel
def _find_sources(
    # outputs
    found: i32_1,  # 1 for rows with a disparity; then the row to fill from, or -1
):
    for _ in range(1):  # one thread, because a row needs the result of the row before
        height = found.shape[0]
        first = height
        for i in range(height):
            if found[height - 1 - i] == 1:
                first = height - 1 - i
        source = first if first < height else -1
        for y in range(height):
            if found[y] == 1:
                source = y
            found[y] = source


@ti.kernel
def _fill_empty_rows(
    found: i32_1,
    # outputs
    filled: f32_2,
):
    for y in range(filled.shape[0]):
        source = found[y]
        if source != y:
            for x in range(filled.shape[1]):
                value = none()
                if source >= 0:
                    value = filled[source, x]
                filled[y, x] = value


@primitive
def fill(disparity: np.ndarray, filled: np.ndarray, valid: np.ndarray) -> None:
    """Fill gaps with the smaller of the disparities to the left and right; mark valid pixels.

    A row without disparities is copied from the nearest row above that has one, or else below. One
    thread per row.
    """
    found = scratch((disparity.shape[0],), np.int32)
    _fill(disparity, filled, valid, found)
    _find_sources(found)
    _fill_empty_rows(found, filled)
