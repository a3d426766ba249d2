"""Peaks among the votes for circles, in Taichi: one thread per row.

A peak is above the limit of its plane. In a window around it, no value is larger, and no equal
value precedes it. Each row counts its peaks; a prefix sum gives the place where it lists them.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)


@ti.kernel
def _row_maxima(
    votes: f32_3,
    # outputs
    tops: f32_1,
):
    for row in range(tops.shape[0]):
        top = -ti.math.inf
        for x in range(votes.shape[2]):
            top = ti.max(top, votes[row // votes.shape[1], row % votes.shape[1], x])
        tops[row] = top


@primitive
def row_maxima(votes: np.ndarray, tops: np.ndarray) -> None:
    """Find the largest value of each row of each plane; one thread per row."""
    _row_maxima(votes, tops)


@ti.func
def _is_peak(
    votes: ti.template(), plane: ti.i32, y: ti.i32, x: ti.i32, down: ti.i32, along: ti.i32
) -> ti.i32:
    """Tell whether no value in the window is larger, and no equal value precedes."""
    v = votes[plane, y, x]
    peak = 1
    for j in range(ti.max(y - down, 0), ti.min(y + down + 1, votes.shape[1])):
        for i in range(ti.max(x - along, 0), ti.min(x + along + 1, votes.shape[2])):
            u = votes[plane, j, i]
            if u > v or (u == v and (j < y or (j == y and i < x))):
                peak = 0
    return peak


@ti.kernel
def _count_peaks(
    votes: f32_3,
    limits: f32_1,
    down: ti.i32,
    along: ti.i32,
    # outputs
    counts: i32_1,
):
    for row in range(counts.shape[0]):
        plane = row // votes.shape[1]
        y = row % votes.shape[1]
        n = 0
        for x in range(votes.shape[2]):
            if votes[plane, y, x] > limits[plane] and _is_peak(votes, plane, y, x, down, along):
                n += 1
        counts[row] = n


@primitive
def count_peaks(
    votes: np.ndarray, limits: np.ndarray, down: int, along: int, counts: np.ndarray
) -> None:
    """Count the peaks of each row; one thread per row."""
    _count_peaks(votes, limits, down, along, counts)


@ti.kernel
def _gather_peaks(
    votes: f32_3,
    limits: f32_1,
    down: ti.i32,
    along: ti.i32,
    starts: i32_1,
    # outputs
    places: i32_2,
    values: f32_1,
):
    for row in range(starts.shape[0] - 1):
        plane = row // votes.shape[1]
        y = row % votes.shape[1]
        n = starts[row]
        for x in range(votes.shape[2]):
            if votes[plane, y, x] > limits[plane] and _is_peak(votes, plane, y, x, down, along):
                places[n, 0] = plane
                places[n, 1] = y
                places[n, 2] = x
                values[n] = votes[plane, y, x]
                n += 1


@primitive
def gather_peaks(
    votes: np.ndarray,
    limits: np.ndarray,
    down: int,
    along: int,
    starts: np.ndarray,
    places: np.ndarray,
    values: np.ndarray,
) -> None:
    """List plane, row, column and votes of the peaks of each row; one thread per row."""
    _gather_peaks(votes, limits, down, along, starts, places, values)
