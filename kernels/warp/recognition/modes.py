"""Maxima of votes, and the modes of their density that mean shift finds, in Warp.

Every sum is of integers, so that no order shows.
"""

import warp as wp

from cvkern.kernels.codes import recognition as codes
from cvkern.kernels.codes.recognition import Space, Window
from cvkern.kernels.warp._launch import launch, launch_each, launch_slabs, slabs

from . import _votes_cpu as cpu
from . import _votes_cuda as cuda
from ._space import cells_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

VOTES_OF_MODE = 1024  # votes that a maximum sees, roughly: for the number of threads only
NOBODY = wp.constant(codes.NOBODY)


def find_maxima(sums: wp.array, space: Space, tiles: wp.array, maxima: wp.array) -> None:
    """Find the best place of each of T tiles of cells; a thread a tile.

    A tile is (bin, first row, first column, row behind the last, column behind the last). The value
    of a cell is the sum over 3 x 3 cells; the first cell wins a tie. `maxima` (T, 4) are row,
    column and scale of the middle of the cell, and its value divided by 9, or all `NOBODY` without
    votes.
    """
    launch_each(_find, tiles.shape[0], 9 * sums.size, [sums, space.bins, tiles], [maxima])


@wp.kernel
def _find(
    stride: int,
    begin: int,
    end: int,
    sums: wp.array[int],
    bins: wp.array2d[int],  # (S, 5)
    tiles: wp.array2d[int],  # (T, 5)
    # outputs
    maxima: wp.array2d[int],  # (T, 4)
):
    for t in range(begin + wp.tid(), end, stride):
        s = tiles[t, 0]
        first = bins[s, 0]
        rows = bins[s, 1]
        columns = bins[s, 2]
        side = bins[s, 4]
        top = wp.int64(0)
        best_row = int(-1)
        best_column = int(-1)
        for row in range(tiles[t, 1], tiles[t, 3]):
            for column in range(tiles[t, 2], tiles[t, 4]):
                value = wp.int64(0)
                for y in range(wp.max(row - 1, 0), wp.min(row + 2, rows)):
                    for x in range(wp.max(column - 1, 0), wp.min(column + 2, columns)):
                        value += wp.int64(sums[first + y * columns + x])
                if value > top:
                    top = value
                    best_row = row
                    best_column = column
        if best_row < 0:
            for k in range(4):
                maxima[t, k] = NOBODY
        else:
            maxima[t, 0] = best_row * side + side // 2
            maxima[t, 1] = best_column * side + side // 2
            maxima[t, 2] = bins[s, 3]
            maxima[t, 3] = int(top // wp.int64(9))


def select_maxima(maxima: wp.array, highest: wp.array) -> None:
    """List the M largest of T maxima with a value above 0, in their order.

    Of equal values the first are taken. Rows of `highest` (M, 4) behind the last are `NOBODY`.
    """
    if highest.device.is_cuda:
        launch(cuda.select, cuda.SELECTORS, [maxima], [highest], cuda.SELECTORS)
        return
    launch_each(_select, 1, 1, [maxima], [highest])


@wp.kernel
def _select(
    stride: int,
    begin: int,
    end: int,
    maxima: wp.array2d[int],  # (T, 4)
    # outputs
    highest: wp.array2d[int],  # (M, 4)
):
    # Bisection finds the largest value that at least M maxima have.
    count = int(maxima.shape[0])
    most = int(highest.shape[0])
    least = int(1)
    top = int(0)
    for t in range(count):
        top = wp.max(top, maxima[t, 3])
    while least < top:
        middle = least + (top - least) // 2 + 1
        there = int(0)
        for t in range(count):
            if maxima[t, 3] >= middle:
                there += 1
        if there >= most:
            least = middle
        else:
            top = middle - 1
    room = int(most)
    for t in range(count):
        if maxima[t, 3] > least:
            room -= 1
    place = int(0)
    for t in range(count):
        value = maxima[t, 3]
        if value > least or (value == least and room > 0):
            for k in range(4):
                highest[place, k] = maxima[t, k]
            place += 1
            if value == least:
                room -= 1
    for t in range(place, most):
        for k in range(4):
            highest[t, k] = NOBODY


def shift_modes(
    votes: wp.array,
    starts: wp.array,
    space: Space,
    window: Window,
    maxima: wp.array,
    modes: wp.array,
) -> None:
    """Move each of T maxima to a mode of the votes' density by mean shift.

    The kernel of Epanechnikov, 1 - d^2, grows with the scale of the place: its gradient leads to
    the mean of the votes within. `modes` (T, 4) are row, column, scale and density.
    """
    count = maxima.shape[0]
    inputs = [cells_of(votes, starts, space), *window, maxima]
    if modes.device.is_cuda:
        launch(cuda.shift, count * cuda.THREADS, inputs, [modes], cuda.THREADS)
        return
    parts = slabs(count, count * VOTES_OF_MODE)
    launch_slabs(cpu.shift, count, min(count, 8 * parts) if parts > 1 else 1, inputs, [modes])


def single_modes(modes: wp.array, spans: wp.array, lowest: int, single: wp.array) -> None:
    """Copy M modes; those outside of their span, or not the first at a place, get density 0.

    `spans` (F, 4) are the least row and column, and the largest, at each scale from `lowest` on; if
    there are none, all places are inside. A mode of density 0 does not count.
    """
    count = modes.shape[0]
    launch_each(_keep_single, count, count, [modes, spans, lowest], [single])


@wp.kernel
def _keep_single(
    stride: int,
    begin: int,
    end: int,
    modes: wp.array2d[int],  # (M, 4)
    spans: wp.array2d[int],  # (F, 4)
    lowest: int,
    # outputs
    single: wp.array2d[int],  # (M, 4)
):
    for t in range(begin + wp.tid(), end, stride):
        y = modes[t, 0]
        x = modes[t, 1]
        z = modes[t, 2]
        density = modes[t, 3]
        if density > 0 and spans.shape[0] > 0:
            f = wp.clamp(z - lowest, 0, spans.shape[0] - 1)
            if y < spans[f, 0] or x < spans[f, 1] or y > spans[f, 2] or x > spans[f, 3]:
                density = int(0)
        if density > 0:
            for i in range(t):
                if modes[i, 3] > 0 and modes[i, 0] == y and modes[i, 1] == x and modes[i, 2] == z:
                    density = int(0)
        single[t, 0] = y
        single[t, 1] = x
        single[t, 2] = z
        single[t, 3] = density
