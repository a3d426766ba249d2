"""Maxima of votes, and the modes of their density that mean shift finds, in Taichi.

Every sum is of integers, so that no order shows.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.recognition import KERNEL_ONE, NOBODY, Space, Window
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi.recognition.votes import _factor, _kernel_at, _scaled

i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
vec3i = ti.types.vector(3, ti.i32)
vec4i = ti.types.vector(4, ti.i32)


@ti.func
def _span(bins: ti.template(), s: ti.i32, y: ti.i32, x: ti.i32, reach: ti.i32) -> vec4i:
    """Return the first rows and columns of cells near a place, and those behind the last."""
    side = bins[s, 4]
    columns = bins[s, 2]
    above = ti.max(y - reach, 0) // side
    below = ti.min((y + reach) // side + 1, bins[s, 1])
    before = ti.min(ti.max(x - reach, 0) // side, columns)
    behind = ti.max(ti.min((x + reach) // side + 1, columns), before)
    return vec4i(above, below, before, behind)


@primitive
def find_maxima(sums: np.ndarray, space: Space, tiles: np.ndarray, maxima: np.ndarray) -> None:
    """Find the best place of each of T tiles of cells; a thread a tile.

    A tile is (bin, first row, first column, row behind the last, column behind the last). The value
    of a cell is the sum over 3 x 3 cells; the first cell wins a tie. `maxima` (T, 4) are row,
    column and scale of the middle of the cell, and its value divided by 9, or all `NOBODY` without
    votes.
    """
    _find(sums, space.bins, tiles, maxima)


@ti.kernel
def _find(
    sums: i32_1,
    bins: i32_2,
    tiles: i32_2,  # (T, 5)
    # outputs
    maxima: i32_2,  # (T, 4)
):
    for t in range(tiles.shape[0]):
        s = tiles[t, 0]
        first = bins[s, 0]
        rows = bins[s, 1]
        columns = bins[s, 2]
        top = ti.cast(0, ti.i64)
        where = NOBODY
        for row in range(tiles[t, 1], tiles[t, 3]):
            for column in range(tiles[t, 2], tiles[t, 4]):
                value = ti.cast(0, ti.i64)
                for y in range(ti.max(row - 1, 0), ti.min(row + 2, rows)):
                    for x in range(ti.max(column - 1, 0), ti.min(column + 2, columns)):
                        value += sums[first + y * columns + x]
                if value > top:
                    top = value
                    where = row * columns + column
        for k in range(4):
            maxima[t, k] = NOBODY
        if where != NOBODY:
            side = bins[s, 4]
            maxima[t, 0] = where // columns * side + side // 2
            maxima[t, 1] = where % columns * side + side // 2
            maxima[t, 2] = bins[s, 3]
            maxima[t, 3] = ti.cast(top // 9, ti.i32)


@primitive
def select_maxima(maxima: np.ndarray, highest: np.ndarray) -> None:
    """List the M largest of T maxima with a value above 0, in their order.

    Of equal values the first are taken. Rows of `highest` (M, 4) behind the last are `NOBODY`.
    """
    _select(maxima, highest)


@ti.func
def _number_above(maxima: ti.template(), least: ti.i32) -> ti.i32:
    """Return how many maxima have at least a value."""
    found = 0
    for t in range(maxima.shape[0]):
        found += ti.cast(maxima[t, 3] >= least, ti.i32)
    return found


@ti.kernel
def _select(
    maxima: i32_2,  # (T, 4)
    # outputs
    highest: i32_2,  # (M, 4)
):
    for _ in range(1):
        # Bisection finds the largest value that at least M maxima have.
        most = highest.shape[0]
        least = 1
        top = 0
        for t in range(maxima.shape[0]):
            top = ti.max(top, maxima[t, 3])
        while least < top:
            middle = least + (top - least) // 2 + 1
            if _number_above(maxima, middle) >= most:
                least = middle
            else:
                top = middle - 1
        room = most
        for t in range(maxima.shape[0]):
            room -= ti.cast(maxima[t, 3] > least, ti.i32)
        place = 0
        for t in range(maxima.shape[0]):
            value = maxima[t, 3]
            if value > least or (value == least and room > 0):
                for k in range(4):
                    highest[place, k] = maxima[t, k]
                place += 1
                room -= ti.cast(value == least, ti.i32)
        for t in range(place, most):
            for k in range(4):
                highest[t, k] = NOBODY


@primitive
def shift_modes(
    votes: np.ndarray,
    starts: np.ndarray,
    space: Space,
    window: Window,
    maxima: np.ndarray,
    modes: np.ndarray,
) -> None:
    """Move each of T maxima to a mode of the votes' density by mean shift; a thread each.

    The kernel of Epanechnikov, 1 - d^2, grows with the scale of the place: its gradient leads to
    the mean of the votes within. `modes` (T, 4) are row, column, scale and density.
    """
    _shift(votes, starts, *space, *window, maxima, modes)


@ti.kernel
def _shift(
    votes: i32_2,  # (V, 4)
    starts: i32_1,
    bins: i32_2,
    slack: ti.i32,
    factors: i32_1,
    lowest: ti.i32,
    radius: ti.i32,
    scales: ti.i32,
    rounds: ti.i32,
    maxima: i32_2,
    # outputs
    modes: i32_2,
):
    for t in range(maxima.shape[0]):
        y = maxima[t, 0]
        x = maxima[t, 1]
        z = maxima[t, 2]
        density = ti.cast(0, ti.i64)
        moving = ti.cast(maxima[t, 3] > 0, ti.i32)
        left = rounds + 1
        while moving == 1 and left > 0:
            left -= 1
            reach = _scaled(radius, _factor(factors, lowest, z))
            mass = ti.cast(0, ti.i64)
            down = ti.cast(0, ti.i64)
            along = ti.cast(0, ti.i64)
            deep = ti.cast(0, ti.i64)
            density = 0
            for s in range(bins.shape[0]):
                if ti.abs(bins[s, 3] - z) <= scales + slack:
                    above, below, before, behind = _span(bins, s, y, x, reach)
                    for row in range(above, below):
                        cell = bins[s, 0] + row * bins[s, 2]
                        end = ti.min(starts[cell + behind], votes.shape[0])
                        for v in range(starts[cell + before], end):
                            apart = vec3i(votes[v, 0] - y, votes[v, 1] - x, votes[v, 2] - z)
                            height = _kernel_at(apart, reach, scales)
                            if height > 0:
                                weight = ti.cast(votes[v, 3], ti.i64)
                                mass += weight
                                down += weight * votes[v, 0]
                                along += weight * votes[v, 1]
                                deep += weight * (votes[v, 2] - lowest)
                                density += weight * height
            moving = 0
            if mass > 0 and left > 0:
                row = ti.cast((2 * down + mass) // (2 * mass), ti.i32)
                column = ti.cast((2 * along + mass) // (2 * mass), ti.i32)
                scale = ti.cast((2 * deep + mass) // (2 * mass), ti.i32) + lowest
                if row != y or column != x or scale != z:
                    moving = 1
                y = row
                x = column
                z = scale
        modes[t, 0] = y
        modes[t, 1] = x
        modes[t, 2] = z
        modes[t, 3] = ti.cast(density // KERNEL_ONE, ti.i32)


@primitive
def single_modes(modes: np.ndarray, spans: np.ndarray, lowest: int, single: np.ndarray) -> None:
    """Copy M modes; those outside of their span, or not the first at a place, get density 0.

    `spans` (F, 4) are the least row and column, and the largest, at each scale from `lowest` on; if
    there are none, all places are inside. A mode of density 0 does not count.
    """
    _keep_single(modes, spans, lowest, single)


@ti.kernel
def _keep_single(
    modes: i32_2,
    spans: i32_2,
    lowest: ti.i32,
    # outputs
    single: i32_2,
):
    for t in range(modes.shape[0]):
        place = vec3i(modes[t, 0], modes[t, 1], modes[t, 2])
        density = modes[t, 3]
        if density > 0 and spans.shape[0] > 0:
            f = ti.min(ti.max(place[2] - lowest, 0), spans.shape[0] - 1)
            for k in ti.static(range(2)):
                if place[k] < spans[f, k] or place[k] > spans[f, k + 2]:
                    density = 0
        if density > 0:
            for i in range(t):
                same = modes[i, 0] == place[0] and modes[i, 1] == place[1]
                if same and modes[i, 2] == place[2] and modes[i, 3] > 0:
                    density = 0
        for k in ti.static(range(3)):
            single[t, k] = place[k]
        single[t, 3] = density
