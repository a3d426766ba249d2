"""Votes for lines, in Taichi."""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.hough import DIRECTIONS
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi.hough._directions import direction_code

i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
i64_1 = ti.types.ndarray(dtype=ti.i64, ndim=1)
f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)


@ti.kernel
def _take(
    points: i32_2,
    starts: i32_1,
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
    """Return rho in bins: fixed point, rounded to the nearest by the half that `offset` has."""
    rho = ti.cast(x, ti.i64) * cosine + ti.cast(y, ti.i64) * sine + offset
    return ti.cast(rho >> ti.cast(shift, ti.i64), ti.i32)


@ti.kernel
def _clear(
    # outputs
    votes: i32_2,
):
    for r, t in votes:
        votes[r, t] = 0


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
    votes: i32_2,
):
    for i in range(points.shape[0]):
        if i < starts[starts.shape[0] - 1]:
            vote = 1
            if weighted != 0:
                vote = weights[i]
            for t in range(votes.shape[1]):
                r = _bin(points[i, 0], points[i, 1], cosine[t], sine[t], offset[t], shift)
                ti.atomic_add(votes[r, t], vote)


@ti.kernel
def _vote_directed(
    points: i32_2,
    starts: i32_1,
    orientation: f32_1,
    first: i32_1,
    number: i32_1,
    cosine: i32_1,
    sine: i32_1,
    offset: i64_1,
    shift: ti.i32,
    weighted: ti.i32,
    weights: i32_1,
    zero: ti.i32,
    # outputs
    votes: i32_2,
):
    for i in range(points.shape[0]):
        if i < starts[starts.shape[0] - 1]:
            vote = 1
            if weighted != 0:
                vote = weights[i]
            code = direction_code(orientation[i], zero) & (DIRECTIONS // 2 - 1)
            for k in range(number[code]):
                t = (first[code] + k) % votes.shape[1]
                r = _bin(points[i, 0], points[i, 1], cosine[t], sine[t], offset[t], shift)
                ti.atomic_add(votes[r, t], vote)


@primitive
def take(points: np.ndarray, starts: np.ndarray, values: np.ndarray, taken: np.ndarray) -> None:
    """Look the value of every point up; one thread a point."""
    _take(points, starts, values, taken)


@primitive
def vote(
    points: np.ndarray,
    starts: np.ndarray,
    cosine: np.ndarray,
    sine: np.ndarray,
    offset: np.ndarray,
    shift: int,
    weighted: bool,
    weights: np.ndarray,
    votes: np.ndarray,
) -> None:
    """Let every point vote at all angles; one thread a point; `votes` is overwritten."""
    _clear(votes)
    _vote(points, starts, cosine, sine, offset, shift, int(weighted), weights, votes)


@primitive
def vote_directed(
    points: np.ndarray,
    starts: np.ndarray,
    orientation: np.ndarray,
    first: np.ndarray,
    number: np.ndarray,
    cosine: np.ndarray,
    sine: np.ndarray,
    offset: np.ndarray,
    shift: int,
    weighted: bool,
    weights: np.ndarray,
    votes: np.ndarray,
) -> None:
    """Let every point vote at the angles of its direction code; one thread a point."""
    _clear(votes)
    _vote_directed(
        points, starts, orientation, first, number, cosine, sine, offset, shift, int(weighted),
        weights, 0, votes,
    )  # fmt: skip
