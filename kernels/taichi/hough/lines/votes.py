"""Votes for lines in Taichi: one thread per point, which adds its votes by atomics.

A point (y, x) votes at angle t for the bin of rho = x cos t + y sin t (Duda and Hart, "Use of the
Hough transformation to detect lines and curves in pictures", CACM 1972). Rho is in fixed point.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.hough import DIRECTIONS, LineTables, LineWindows
from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi.hough._directions import direction_code

i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
i64_1 = ti.types.ndarray(dtype=ti.i64, ndim=1)
f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_3 = ti.types.ndarray(dtype=ti.i32, ndim=3)  # (images, rho, theta)


@ti.kernel
def _take(
    points: i32_2,  # (capacity, 2), row by row
    starts: i32_1,  # where the points of each row begin; its last element is their number
    values: f32_2,
    # outputs
    taken: f32_1,
):
    for i in range(points.shape[0]):
        if i < starts[starts.shape[0] - 1]:
            taken[i] = values[points[i, 0], points[i, 1]]


@ti.func
def _bin(
    y: ti.i32, x: ti.i32, cosine: ti.i32, sine: ti.i32, offset: ti.i64, shift: ti.i32
) -> ti.i32:
    """Return rho in bins, from fixed point; `offset` includes a half, so this rounds."""
    rho = ti.cast(x, ti.i64) * cosine + ti.cast(y, ti.i64) * sine + offset
    return ti.cast(rho >> ti.cast(shift, ti.i64), ti.i32)


@ti.func
def _place(row: ti.i32, rows: ti.i32, images: ti.i32):
    """Return the image of a point, and its row there: `rows` are those of all images together."""
    n = 0
    if images > 1:
        n = row // (rows // images)
    return n, row - n * (rows // images)


@ti.kernel
def _clear(
    # outputs
    votes: i32_3,
):
    for n, r, t in votes:
        votes[n, r, t] = 0


@ti.kernel
def _vote(
    points: i32_2,
    starts: i32_1,
    cosine: i32_1,
    sine: i32_1,
    offset: i64_1,
    shift: ti.i32,
    weighted: ti.i32,
    weights: i32_1,
    # outputs
    votes: i32_3,
):
    for i in range(points.shape[0]):
        if i < starts[starts.shape[0] - 1]:
            vote = 1
            if weighted != 0:
                vote = weights[i]
            n, y = _place(points[i, 0], starts.shape[0] - 1, votes.shape[0])
            for t in range(votes.shape[2]):
                r = _bin(y, points[i, 1], cosine[t], sine[t], offset[t], shift)
                ti.atomic_add(votes[n, r, t], vote)


@ti.kernel
def _code(
    points: i32_2,
    starts: i32_1,
    orientation: f32_1,
    zero: ti.i32,
    # outputs
    codes: i32_1,
):
    for i in range(points.shape[0]):
        if i < starts[starts.shape[0] - 1]:
            codes[i] = direction_code(orientation[i], zero) & (DIRECTIONS // 2 - 1)


@ti.kernel
def _vote_directed(
    starts: i32_1,
    codes: i32_1,
    first: i32_1,
    number: i32_1,
    points: i32_2,
    cosine: i32_1,
    sine: i32_1,
    offset: i64_1,
    shift: ti.i32,
    weighted: ti.i32,
    weights: i32_1,
    # outputs
    votes: i32_3,
):
    for i in range(points.shape[0]):
        if i < starts[starts.shape[0] - 1]:
            vote = 1
            if weighted != 0:
                vote = weights[i]
            n, y = _place(points[i, 0], starts.shape[0] - 1, votes.shape[0])
            for k in range(number[codes[i]]):
                t = (first[codes[i]] + k) % votes.shape[2]
                r = _bin(y, points[i, 1], cosine[t], sine[t], offset[t], shift)
                ti.atomic_add(votes[n, r, t], vote)


@primitive
def take(points: np.ndarray, starts: np.ndarray, values: np.ndarray, taken: np.ndarray) -> None:
    """Look up the value at every point; one thread per point."""
    _take(points, starts, values, taken)


@primitive
def vote(
    points: np.ndarray,
    starts: np.ndarray,
    tables: LineTables,
    weights: np.ndarray | None,
    votes: np.ndarray,
) -> None:
    """Count the votes of all points at all angles, by 1 or their weight; one thread per point.

    `votes` are (R, T), or (N, R, T) of a stack. Then the points are those of all images, one image
    after the other, and their rows are numbered on from image to image.
    """
    votes = votes.reshape((1, *votes.shape)[-3:])
    _clear(votes)
    given = starts if weights is None else weights  # without weights, any array of the same type
    _vote(points, starts, *tables, int(weights is not None), given, votes)


@primitive
def vote_directed(
    points: np.ndarray,
    starts: np.ndarray,
    windows: LineWindows,
    tables: LineTables,
    weights: np.ndarray | None,
    votes: np.ndarray,
) -> None:
    """Count the votes of all points at the angles of their direction; one thread per point."""
    directions = scratch((points.shape[0],), np.int32)
    _code(points, starts, windows.orientation, 0, directions)
    votes = votes.reshape((1, *votes.shape)[-3:])
    _clear(votes)
    given = starts if weights is None else weights
    weighted = int(weights is not None)
    _vote_directed(
        starts, directions, windows.first, windows.number, points, *tables, weighted, given, votes
    )
