"""Mirrored places beyond a border, and the values that an image can hold, in Taichi."""

import numpy as np
import taichi as ti


@ti.func
def mirror(i: ti.i32, n: ti.i32) -> ti.i32:
    """Return the place within n that place i is the mirror image of, at the last element."""
    period = 2 * n - 2
    j = ti.abs(i) % period
    if j >= n:
        j = period - j
    return j


@ti.func
def rounded(value: ti.f32, highest: ti.f32) -> ti.f32:
    """Return `value`, to an integer up to `highest` where there is one."""
    result = value
    if highest > 0.0:
        result = ti.floor(ti.math.clamp(value + 0.5, 0.0, highest))
    return result


def highest(array: np.ndarray) -> float:
    """Return the highest value of an integral array, or 0."""
    dtype = np.dtype(array.dtype)
    return float(np.iinfo(dtype).max) if dtype.kind == "u" else 0.0
