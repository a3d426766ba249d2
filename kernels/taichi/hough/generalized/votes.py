"""The generalised Hough transform in Taichi: one thread per slice and entry.

An entry of the table is a vector v from a boundary point to the centre, and the direction of the
gradient there. For a rotation t and a scale s, each edge point p whose direction is that of the
entry, rotated by t, votes for the centre p + s R(t) v (Ballard, "Generalizing the Hough transform
to detect arbitrary shapes", Pattern Recognition 13(2), 1981). A slice holds the votes of one
rotation and one scale.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.hough import (
    DIRECTIONS,
    SCALE_ONE,
    TILE,
    TURN_ONE,
    TURNED_ONE,
    VECTOR_ONE,
    Cells,
    Entries,
    Slices,
    Voters,
)
from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi._polar import gradient_angle
from cvkern.kernels.taichi.hough._directions import direction_code

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
i32_4 = ti.types.ndarray(dtype=ti.i32, ndim=4)

_DOWN_BITS = (TURN_ONE * VECTOR_ONE // TURNED_ONE).bit_length() - 1
_ONE_BITS = (TURNED_ONE * SCALE_ONE).bit_length() - 1


@ti.kernel
def _code_directions(
    points: i32_2,
    dy: f32_2,
    dx: f32_2,
    zero: ti.i32,
    # outputs
    codes: i32_1,
):
    for i in range(codes.shape[0]):
        y = points[i, 0]
        x = points[i, 1]
        codes[i] = direction_code(gradient_angle(dy[y, x], dx[y, x], zero), zero)


@primitive
def code_directions(points: np.ndarray, dy: np.ndarray, dx: np.ndarray, codes: np.ndarray) -> None:
    """Compute the direction code of the gradient at each point; one thread per point."""
    _code_directions(points, dy, dx, 0, codes)


@ti.func
def _scaled(turned: ti.i64, scale: ti.i32) -> ti.i32:
    """Return a rotated vector's component, scaled, in whole pixels; halves are rounded up."""
    return (ti.cast(turned, ti.i32) * scale + (1 << (_ONE_BITS - 1))) >> _ONE_BITS


@ti.kernel
def _vote(
    points: i32_2,
    starts: i32_1,
    vectors: i32_2,
    directions: i32_1,
    turns: i32_2,
    scales: i32_1,
    tolerance: ti.i32,
    height: ti.i32,
    width: ti.i32,
    shift: ti.i32,
    # outputs
    votes: i32_4,
):
    for r, s, row, column in votes:
        votes[r, s, row, column] = 0
    for r, s, e in ti.ndrange(turns.shape[0], scales.shape[0], directions.shape[0]):
        y = ti.cast(vectors[e, 0], ti.i64)
        x = ti.cast(vectors[e, 1], ti.i64)
        half = ti.cast(1 << (_DOWN_BITS - 1), ti.i64)
        turned_y = (y * turns[r, 1] + x * turns[r, 2] + half) >> _DOWN_BITS
        turned_x = (x * turns[r, 1] - y * turns[r, 2] + half) >> _DOWN_BITS
        dy = _scaled(turned_y, scales[s])
        dx = _scaled(turned_x, scales[s])
        low = (directions[e] + turns[r, 0] - tolerance) & (DIRECTIONS - 1)
        for i in range(starts[low], starts[low + 2 * tolerance + 1]):
            row = points[0, i] + dy
            column = points[1, i] + dx
            if 0 <= row < height and 0 <= column < width:
                ti.atomic_add(votes[r, s, row >> shift, column >> shift], 1)


@primitive
def accumulate(
    voters: Voters,
    entries: Entries,
    slices: Slices,
    tolerance: int,
    cells: Cells,
    votes: np.ndarray,
) -> None:
    """Count the votes of each cell of each slice; one thread per slice and entry."""
    _vote(*voters, *entries, *slices, tolerance, *cells, votes)


@ti.kernel
def _find_peaks(
    votes: i32_4,
    # outputs
    keys: i32_4,
):
    for r, s, down, across in keys:
        best = 0
        for i in range(TILE):
            for j in range(TILE):
                row = down * TILE + i
                column = across * TILE + j
                if row < votes.shape[2] and column < votes.shape[3]:
                    number = 0
                    for v in ti.static(range(2)):
                        for u in ti.static(range(2)):
                            if row + v < votes.shape[2] and column + u < votes.shape[3]:
                                number += votes[r, s, row + v, column + u]
                    place = TILE * TILE - 1 - i * TILE - j
                    best = ti.max(best, number * (TILE * TILE) + place)
        keys[r, s, down, across] = best


@primitive
def search(
    voters: Voters,
    entries: Entries,
    slices: Slices,
    tolerance: int,
    cells: Cells,
    keys: np.ndarray,
) -> None:
    """Find the 2 x 2 cells with most votes in each tile of each slice; one thread per tile."""
    rows, columns = (((n - 1) >> cells.shift) + 1 for n in cells[:2])
    votes = scratch((slices.turns.shape[0], slices.scales.shape[0], rows, columns), np.int32)
    _vote(*voters, *entries, *slices, tolerance, *cells, votes)
    _find_peaks(votes, keys)
