"""Votes of words for centres of objects, their maxima, and mean shift on them, in Warp.

A patch with m words casts the weights of each word's occurrences, divided by m and rounded down.
Every sum is of integers, so that no order shows. On the CPU a thread has the votes for some rows of
cells; on CUDA a few threads have one word of one patch.
"""

import numpy as np
import warp as wp

from cvkern.kernels.codes import recognition as codes
from cvkern.kernels.codes.recognition import Occurrences, Patches, Space, Window
from cvkern.kernels.warp._launch import launch, launch_each, launch_slabs, scratch, slabs
from cvkern.kernels.warp._sums import scan
from cvkern.kernels.warp._zeros import clear

from . import _votes_cpu as cpu
from . import _votes_cuda as cuda
from ._space import Ballot, ballot_of, cells_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# Votes of a word, and votes that a maximum sees, roughly: for the number of threads only.
VOTES_OF_WORD, VOTES_OF_MODE = 32, 1024
AROUND = wp.constant(codes.AROUND)
NOBODY = wp.constant(codes.NOBODY)
MARKED = (2 * codes.AROUND + 1) ** 2
BANDS = 4  # bands of cells of a thread on the CPU


def count_votes(
    patches: Patches, occurrences: Occurrences, space: Space, sums: wp.array, counts: wp.array
) -> None:
    """Add up the weights of the votes for each of C cells, and count the votes."""
    ballot = ballot_of(patches, occurrences, space, 0, counts)
    if not sums.device.is_cuda:
        _cast(ballot, [sums, counts, None])
        return
    cells = scratch("recognition.room", counts.shape, wp.uint64, counts.device)
    clear(cells)
    launch(cuda.cast, patches.matches.size * cuda.LANES, [ballot], [cells, None])
    launch(cuda.split, counts.size, [cells], [sums, counts])


def mark_votes(
    maxima: wp.array, space: Space, window: Window, counts: wp.array, starts: wp.array
) -> None:
    """List where the votes of each cell begin that is within `AROUND` cells of a maximum.

    Other cells have no room in `starts` (C + 1,), which ends with the number of votes. Every bin is
    marked that the kernel of mean shift reaches.
    """
    clear(starts)
    bins = space.bins.shape[0]
    reach = window.scales + space.slack
    count = maxima.shape[0] * bins
    launch_each(_mark, count, count * MARKED, [maxima, space.bins, reach, counts], [starts])
    scan(starts)


@wp.kernel
def _mark(
    stride: int,
    begin: int,
    end: int,
    maxima: wp.array2d[int],  # (T, 4)
    bins: wp.array2d[int],  # (S, 5)
    reach: int,
    counts: wp.array[int],
    # outputs
    starts: wp.array[int],  # (C + 1,)
):
    for item in range(begin + wp.tid(), end, stride):
        t = item // bins.shape[0]
        s = item - t * bins.shape[0]
        if maxima[t, 3] > 0 and wp.abs(bins[s, 3] - maxima[t, 2]) <= reach:
            row = maxima[t, 0] // bins[s, 4]
            column = maxima[t, 1] // bins[s, 4]
            left = wp.max(column - AROUND, 0)
            right = wp.min(column + AROUND + 1, bins[s, 2])
            for y in range(wp.max(row - AROUND, 0), wp.min(row + AROUND + 1, bins[s, 1])):
                for x in range(left, right):
                    c = bins[s, 0] + y * bins[s, 2] + x
                    starts[c + 1] = counts[c]


def list_votes(
    patches: Patches,
    occurrences: Occurrences,
    space: Space,
    starts: wp.array,
    votes: wp.array,
) -> None:
    """List the votes of each cell with room, in any order: V rows of place, scale and weight.

    Cells whose votes would lie behind the last row are left out.
    """
    ballot = ballot_of(patches, occurrences, space, 1, starts)
    if not starts.device.is_cuda:
        _cast(ballot, [starts, starts, votes])
        return
    cells = scratch("recognition.room", (starts.size - 1,), wp.uint64, starts.device)
    clear(cells)
    launch(cuda.cast, patches.matches.size * cuda.LANES, [ballot], [cells, votes])


def _cast(ballot: Ballot, outputs: list) -> None:
    """Count or list votes on the CPU; a thread takes bands of cells."""
    device, matches, entries = ballot.places.device, ballot.matches, ballot.entries.shape[0]
    bins, levels, words = (a.shape[0] for a in (ballot.bins, ballot.levels, ballot.begins))
    parts = slabs(matches.shape[0], matches.size * VOTES_OF_WORD)
    at_words = scratch("recognition.laid", (levels, bins, 3 * words), wp.int32, device)
    live = scratch("recognition.live", (levels, 4, entries + cpu.LANES), wp.int32, device)
    launch_slabs(cpu.lay, levels, min(parts, levels), [ballot], [at_words, live])
    bands, cells = _bands(ballot.bins.numpy(), BANDS * parts if parts > 1 else 1)
    room = scratch("recognition.room", (cells + len(bands) * cpu.LANES,), wp.uint64, device)
    inputs = [ballot, wp.array(bands, dtype=wp.int32, device=device, copy=False), at_words, live]
    launch_slabs(cpu.cast, len(bands), len(bands), [*inputs, room], outputs)


def _bands(bins: np.ndarray, count: int) -> tuple[np.ndarray, int]:
    """Return about `count` bands of rows of the bins (B, 3), and the number of cells."""
    cells = bins[:, 1] * bins[:, 2]
    found = []
    for s, (rows, own) in enumerate(zip(bins[:, 1], cells, strict=True)):
        number = min(max(1, round(count * own / cells.sum())), rows)
        ends = rows * np.arange(number + 1) // number
        found.append(np.column_stack([np.full(number, s), ends[:-1], ends[1:]]))
    return np.concatenate(found).astype(np.int32), int(cells.sum())


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
                maxima[t, k] = -1
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
    there are none, all places are inside. A mode of density 0 is none.
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
