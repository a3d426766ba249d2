"""Votes for circles in Taichi: each set pixel adds to what it votes for."""

import numpy as np
import taichi as ti

from ..codes import DIRECTIONS
from ._directions import direction_code
from ._launch import primitive, scratch
from ._rounding import quotient

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
i32_3 = ti.types.ndarray(dtype=ti.i32, ndim=3)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)


@ti.func
def _vote(votes: ti.template(), ring: ti.i32, y: ti.i32, x: ti.i32):
    if 0 <= y < votes.shape[1] and 0 <= x < votes.shape[2]:
        ti.atomic_add(votes[ring, y, x], 1)


@ti.kernel
def _vote_rings(
    mask: u8_2,
    offsets: i32_2,
    starts: i32_1,
    # outputs
    votes: i32_3,
):
    for ring, y, x in votes:
        votes[ring, y, x] = 0
    pad = (votes.shape[2] - mask.shape[1]) // 2
    for y, x in mask:
        if mask[y, x] != 0:
            for ring in range(votes.shape[0]):
                for k in range(starts[ring], starts[ring + 1]):
                    _vote(votes, ring, y + pad - offsets[k, 0], x + pad - offsets[k, 1])


@ti.kernel
def _vote_directed(
    points: i32_2,
    starts: i32_1,
    orientation: f32_2,
    radii: i32_1,
    directions: i32_2,
    tolerance: ti.i32,
    offsets: i32_2,
    codes: i32_1,
    offset_starts: i32_1,
    zero: ti.i32,
    # outputs
    votes: i32_3,
):
    for ring, y, x in votes:
        votes[ring, y, x] = 0
    pad = (votes.shape[2] - orientation.shape[1]) // 2
    for i in range(starts[starts.shape[0] - 1]):
        y = points[i, 0] + pad
        x = points[i, 1] + pad
        code = direction_code(orientation[points[i, 0], points[i, 1]], zero)
        for ring in range(votes.shape[0]):
            if tolerance < 0:
                down = (radii[ring] * directions[code, 0] + 32768) >> 16
                along = (radii[ring] * directions[code, 1] + 32768) >> 16
                _vote(votes, ring, y + down, x + along)
                _vote(votes, ring, y - down, x - along)
            else:
                for k in range(offset_starts[ring], offset_starts[ring + 1]):
                    for side in range(2):
                        apart = codes[k] - code + side * (DIRECTIONS // 2) + tolerance
                        if (apart & (DIRECTIONS - 1)) <= 2 * tolerance:
                            _vote(votes, ring, y + offsets[k, 0], x + offsets[k, 1])


@ti.kernel
def _share(
    votes: i32_3,
    starts: i32_1,
    zero: ti.i32,
    # outputs
    shares: f32_3,
):
    for ring, y, x in votes:
        size = ti.cast(starts[ring + 1] - starts[ring], ti.f32)
        shares[ring, y, x] = quotient(ti.cast(votes[ring, y, x], ti.f32), size, zero)


def _counts(votes: np.ndarray) -> np.ndarray:
    """Return where to count: in the result itself, unless that is for shares."""
    return scratch(votes.shape, np.int32) if votes.dtype == np.float32 else votes


@primitive
def vote_rings(
    mask: np.ndarray, offsets: np.ndarray, starts: np.ndarray, reach: int, votes: np.ndarray
) -> None:
    """Cast a vote for each offset of each ring from each set pixel; one thread a pixel."""
    counts = _counts(votes)
    _vote_rings(mask, offsets, starts, counts)
    if counts is not votes:
        _share(counts, starts, 0, votes)


@primitive
def vote_directed(
    points: np.ndarray,
    starts: np.ndarray,
    orientation: np.ndarray,
    radii: np.ndarray,
    directions: np.ndarray,
    tolerance: int,
    offsets: np.ndarray,
    codes: np.ndarray,
    offset_starts: np.ndarray,
    votes: np.ndarray,
) -> None:
    """Cast the votes that lie along the gradient; one thread a point."""
    counts = _counts(votes)
    _vote_directed(
        points, starts, orientation, radii, directions, tolerance, offsets, codes, offset_starts,
        0, counts,
    )  # fmt: skip
    if counts is not votes:
        _share(counts, offset_starts, 0, votes)


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
    """Find the largest of each row of each plane; one thread a row."""
    _row_maxima(votes, tops)


@ti.func
def _is_peak(
    votes: ti.template(), plane: ti.i32, y: ti.i32, x: ti.i32, down: ti.i32, along: ti.i32
) -> ti.i32:
    """Whether none within the distances is larger, nor equal and before."""
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
    """Count the peaks of each row; one thread a row."""
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
    """List plane, row, column and votes of the peaks of each row; one thread a row."""
    _gather_peaks(votes, limits, down, along, starts, places, values)
