"""Values that a picture can hold."""

import numpy as np
import taichi as ti


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
