"""Removal of small regions of disparities, in Taichi.

Two pixels that share a side belong to one region if they differ by at most `difference`. Regions
are found by union-find: pixel i of the raster has label i, and a parent that is never larger. Trees
of labels are joined, and their roots count the pixels. One thread per pixel.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi.edges._hysteresis import find, join

from ._bits import is_finite, none

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)


@ti.func
def _alike(a: ti.f32, b: ti.f32, difference: ti.f32) -> ti.i32:
    alike = 0
    if is_finite(a) and is_finite(b):
        if ti.abs(a - b) <= difference:
            alike = 1
    return alike


@ti.kernel
def _plant(
    # outputs
    parents: i32_1,
    sizes: i32_1,
):
    for i in parents:
        parents[i] = i
        sizes[i] = 0


@ti.kernel
def _unite(
    disparity: f32_2,
    difference: ti.f32,
    # outputs
    parents: i32_1,
):
    for y, x in disparity:
        label = y * disparity.shape[1] + x
        if x > 0:
            if _alike(disparity[y, x], disparity[y, x - 1], difference):
                join(label, label - 1, parents)
        if y > 0:
            if _alike(disparity[y, x], disparity[y - 1, x], difference):
                join(label, label - disparity.shape[1], parents)


@ti.kernel
def _count(
    parents: i32_1,
    # outputs
    sizes: i32_1,
):
    for i in parents:
        ti.atomic_add(sizes[find(i, parents)], 1)


@ti.kernel
def _keep(
    disparity: f32_2,
    min_size: ti.i32,
    parents: i32_1,
    sizes: i32_1,
    # outputs
    kept: f32_2,
):
    for y, x in disparity:
        label = y * disparity.shape[1] + x
        large = sizes[find(label, parents)] >= min_size
        kept[y, x] = disparity[y, x] if large else none()


@primitive
def remove_speckles(
    disparity: np.ndarray, min_size: int, difference: float, kept: np.ndarray
) -> None:
    """Keep the regions of at least `min_size` pixels; neighbours differ by at most `difference`.

    By union-find; one thread per pixel.
    """
    size = disparity.shape[0] * disparity.shape[1]
    parents, sizes = scratch((size,), np.int32), scratch((size,), np.int32)
    _plant(parents, sizes)
    _unite(disparity, difference, parents)
    _count(parents, sizes)
    _keep(disparity, min_size, parents, sizes, kept)
