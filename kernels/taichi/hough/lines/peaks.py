"""Maxima of an accumulator of lines, in Taichi: one thread per element.

A maximum is above a threshold. In a window around it, no value is larger, and no equal value
precedes it. The window may continue past the last angle, at the first: after half a turn, rho
changes its sign.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.hough import LineTables, LineWindows
from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi.hough import points as masks

from . import votes as accumulators

MOST_VOTES = 2**31 - 1
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i64_1 = ti.types.ndarray(dtype=ti.i64, ndim=1)
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


@ti.kernel
def _list_keys(
    values: i32_2,
    starts: i32_1,
    bins: i32_2,
    # outputs
    keys: i64_1,
    total: i32_1,
):
    number = starts[starts.shape[0] - 1]
    total[0] = number
    for i in range(number):
        place = ti.cast(bins[i, 0], ti.i64) * values.shape[1] + bins[i, 1]
        less = ti.cast(MOST_VOTES - values[bins[i, 0], bins[i, 1]], ti.i64)
        keys[i] = (less << 32) + place


@primitive
def find_lines(
    points: np.ndarray,
    starts: np.ndarray,
    windows: LineWindows,
    tables: LineTables,
    shape: tuple[int, int],
    threshold: int,
    apart: tuple[int, int],
    keys: np.ndarray,
    total: np.ndarray,
) -> None:
    """List the lines with more votes than the threshold that are the first largest near them.

    Votes are those of `vote_directed` in (R, T) bins; the angles cover half a turn, and each
    direction has one or more. Near are at most `apart` bins of rho and theta, 1 or more, as in
    `local_maxima`. A key is 2^31 - 1 less the votes, shifted by 32, plus the number of the bin, row
    by row.
    """
    votes, mask = scratch(shape, np.int32), scratch(shape, np.uint8)
    counts, bins = scratch((shape[0] + 1,), np.int32), scratch((keys.shape[0], 2), np.int32)
    accumulators.vote_directed(points, starts, windows, tables, None, votes)
    local_maxima(votes, threshold, *apart, True, mask)
    masks.count(mask, counts)
    masks.gather(mask, counts, bins)
    _list_keys(votes, counts, bins, keys, total)
