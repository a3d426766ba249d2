"""Refinement of disparity maps, where NaN stands for no disparity, in Taichi."""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi.edges._hysteresis import find, join

any_2 = ti.types.ndarray(ndim=2)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)

# Floats are told apart by their bits: on CUDA the compiler takes NaN for impossible.
INFINITY, NAN, MAGNITUDE = 0x7F800000, 0x7FC00000, 0x7FFFFFFF


@ti.func
def _none() -> ti.f32:
    """Return the NaN that stands for no disparity."""
    return ti.bit_cast(NAN, ti.f32)


@ti.func
def _is_finite(value: ti.f32) -> ti.i32:
    return (ti.bit_cast(value, ti.i32) & MAGNITUDE) < INFINITY


@ti.func
def _is_number(value: ti.f32) -> ti.i32:
    return (ti.bit_cast(value, ti.i32) & MAGNITUDE) <= INFINITY


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
        kept = _none()
        if _is_finite(d):
            at = ti.cast(x, ti.f32) - ti.floor(d + 0.5)
            if 0.0 <= at < width:
                match = right[y, ti.cast(at, ti.i32)]
                other = ti.cast(match, ti.f32)
                exists = _is_finite(other)
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
    """Keep the disparities that the right image shares; one thread per pixel.

    `right` is float32 disparities, or int32 indices that count from `first` on and are negative
    where there is none.
    """
    _left_right(disparity, right, first, right.dtype == np.int32, tolerance, checked)


# Speckles. Pixel i of the raster has label i, and its parent is never larger.


@ti.func
def _alike(a: ti.f32, b: ti.f32, difference: ti.f32) -> ti.i32:
    alike = 0
    if _is_finite(a) and _is_finite(b):
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
        kept[y, x] = disparity[y, x] if large else _none()


@primitive
def remove_speckles(
    disparity: np.ndarray, min_size: int, difference: float, kept: np.ndarray
) -> None:
    """Keep the regions of at least `min_size` pixels, whose neighbours differ by `difference`.

    By union-find; one thread per pixel.
    """
    size = disparity.shape[0] * disparity.shape[1]
    parents, sizes = scratch((size,), np.int32), scratch((size,), np.int32)
    _plant(parents, sizes)
    _unite(disparity, difference, parents)
    _count(parents, sizes)
    _keep(disparity, min_size, parents, sizes, kept)


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
            here = _is_finite(disparity[y, x])
            if here:
                nearest = disparity[y, x]
                begin = ti.min(begin, x)
            valid[y, x] = ti.cast(here, ti.u8)
            filled[y, x] = nearest
        found[y] = ti.cast(begin < width, ti.i32)
        behind = 0  # whether there is one behind x
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
    found: i32_1,  # which rows have a disparity; then which row each one is filled from, or -1
):
    for _ in range(1):  # one thread: a row needs what the one before has found
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
                value = _none()
                if source >= 0:
                    value = filled[source, x]
                filled[y, x] = value


@primitive
def fill(disparity: np.ndarray, filled: np.ndarray, valid: np.ndarray) -> None:
    """Fill gaps with the smaller of the disparities to the left and right; tell where none was.

    A row without any is that of the nearest row above that has some, else below. One thread per
    row.
    """
    found = scratch((disparity.shape[0],), np.int32)
    _fill(disparity, filled, valid, found)
    _find_sources(found)
    _fill_empty_rows(found, filled)


@ti.func
def _inside(i: ti.i32, size: ti.i32) -> ti.i32:
    return ti.min(ti.max(i, 0), size - 1)


@ti.kernel
def _median(
    disparity: f32_2,
    guide: u8_2,
    radius: ti.i32,
    contrast: ti.i32,
    dy: ti.i32,  # the line of the window: (1, 0) or (0, 1)
    dx: ti.i32,
    # outputs
    smooth: f32_2,
):
    height = disparity.shape[0]
    width = disparity.shape[1]
    for y, x in smooth:
        # Of the values in the window, the smallest that with all smaller and equal ones has at
        # least half of the weight.
        exists = 0
        best = 0.0
        for i in range(-radius, radius + 1):
            value = disparity[_inside(y + i * dy, height), _inside(x + i * dx, width)]
            if _is_number(value):
                total = 0
                below = 0
                for j in range(-radius, radius + 1):
                    v = _inside(y + j * dy, height)
                    u = _inside(x + j * dx, width)
                    other = disparity[v, u]
                    step = ti.cast(guide[v, u], ti.i32) - ti.cast(guide[y, x], ti.i32)
                    weight = ti.max(1, contrast - ti.abs(step))
                    if _is_number(other):
                        total += weight
                        if other <= value:
                            below += weight
                if 2 * below >= total and (exists == 0 or value < best):
                    best = value + 0.0  # no -0
                    exists = 1
        smooth[y, x] = best if exists == 1 else _none()


@primitive
def guided_median(
    disparity: np.ndarray, guide: np.ndarray, radius: int, contrast: int, smooth: np.ndarray
) -> None:
    """Weighted median along the rows, then of that down the columns; one thread per pixel.

    A pixel that differs by g from the middle one in the guide weighs ``max(1, contrast - g)``. The
    image is continued by its nearest pixel.
    """
    across = scratch(smooth.shape, np.float32)
    _median(disparity, guide, radius, contrast, 0, 1, across)
    _median(across, guide, radius, contrast, 1, 0, smooth)
