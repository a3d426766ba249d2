"""Maxima of an accumulator of lines, in Taichi: one thread per element.

A maximum is above a threshold. In a window around it, no value is larger, and no equal value
precedes it. The window may continue past the last angle, at the first: after half a turn, rho
changes its sign.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive

u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
f64_1 = ti.types.ndarray(dtype=ti.f64, ndim=1)


@ti.kernel
def _local_maxima(
    values: ti.types.ndarray(ndim=2),
    threshold: ti.f64,
    min_distance: ti.i32,
    min_angle: ti.i32,
    wraps: ti.i32,
    # outputs
    mask: u8_2,
):
    for bin, angle in values:
        here = values[bin, angle]
        found = here > threshold
        if found:
            for dt in range(-min_angle, min_angle + 1):
                t = angle + dt
                middle = bin
                if wraps != 0 and (t < 0 or t >= values.shape[1]):
                    t += values.shape[1] if t < 0 else -values.shape[1]
                    middle = values.shape[0] - 1 - bin  # after half a turn, rho changes its sign
                if 0 <= t < values.shape[1]:
                    low = ti.max(middle - min_distance, 0)
                    high = ti.min(middle + min_distance, values.shape[0] - 1)
                    for r in range(low, high + 1):
                        before = r < bin or (r == bin and t < angle)
                        if values[r, t] > here or (values[r, t] == here and before):
                            found = False
        mask[bin, angle] = ti.cast(found, ti.u8)


@primitive
def local_maxima(
    values: np.ndarray,
    threshold: float,
    min_distance: int,
    min_angle: int,
    wraps: bool,
    mask: np.ndarray,
) -> None:
    """Mark values above the threshold that are the first largest in their window."""
    _local_maxima(values, float(threshold), min_distance, min_angle, int(wraps), mask)


@ti.kernel
def _take(
    values: ti.types.ndarray(ndim=2),
    bins: i32_2,
    # outputs
    taken: f64_1,
):
    for i in taken:
        taken[i] = ti.cast(values[bins[i, 0], bins[i, 1]], ti.f64)


@primitive
def take(values: np.ndarray, bins: np.ndarray, taken: np.ndarray) -> None:
    """Look up the values of bins (K, 2); one thread per bin."""
    _take(values, bins, taken)
