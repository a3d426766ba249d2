"""The set pixels of a mask as a list, in Taichi; one thread per row.

The set pixels of each row are counted. A prefix sum of the counts gives the place where each row
lists its points, so the list is in raster order.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive

i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)


@ti.kernel
def _count(
    mask: u8_2,
    # outputs
    starts: i32_1,
):
    for y in range(mask.shape[0]):
        number = 0
        for x in range(mask.shape[1]):
            if mask[y, x] != 0:
                number += 1
        starts[y + 1] = number


@ti.kernel
def _add_up(
    # outputs
    starts: i32_1,
):
    ti.loop_config(serialize=True)
    for y in range(starts.shape[0]):
        if y == 0:
            starts[y] = 0
        else:
            starts[y] = starts[y] + starts[y - 1]


@ti.kernel
def _gather(
    mask: u8_2,
    starts: i32_1,
    # outputs
    points: i32_2,
):
    for y in range(mask.shape[0]):
        i = starts[y]
        for x in range(mask.shape[1]):
            if mask[y, x] != 0:
                points[i, 0] = y
                points[i, 1] = x
                i += 1


@ti.kernel
def _first_outside(
    points: i32_2,
    starts: i32_1,
    values: f32_2,
    low: ti.f32,
    high: ti.f32,
    # outputs
    index: i32_1,
):
    for i in range(points.shape[0]):
        if i < starts[starts.shape[0] - 1]:
            value = values[points[i, 0], points[i, 1]]
            if not (value >= low and value <= high):
                ti.atomic_min(index[0], i)


@ti.kernel
def _number_of(
    starts: i32_1,
    # outputs
    index: i32_1,
):
    index[0] = starts[starts.shape[0] - 1]


@primitive
def count(mask: np.ndarray, starts: np.ndarray) -> None:
    """Count the set pixels above each row; one thread per row, then one thread for the sums."""
    _count(mask, starts)
    _add_up(starts)


@primitive
def gather(mask: np.ndarray, starts: np.ndarray, points: np.ndarray) -> None:
    """List row and column of the set pixels; one thread per row."""
    _gather(mask, starts, points)


@primitive
def first_outside(
    points: np.ndarray,
    starts: np.ndarray,
    values: np.ndarray,
    low: float,
    high: float,
    index: np.ndarray,
) -> None:
    """Find the first point whose value is outside [low, high], or the number of points."""
    _number_of(starts, index)
    _first_outside(points, starts, values, low, high, index)
