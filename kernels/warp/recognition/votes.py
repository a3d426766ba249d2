"""Votes of words for centres of objects, their maxima, and mean shift on them, in Warp.

A patch with m words casts the weights of each word's occurrences, divided by m and rounded down.
Every sum is of integers, so that no order shows. On the CPU a thread has the votes of whole bins;
on CUDA it has one word of one patch.
"""

import warp as wp

from cvkern.kernels.codes import recognition as codes
from cvkern.kernels.codes.recognition import Occurrences, Patches, Space, Window
from cvkern.kernels.warp._launch import launch, launch_each, launch_slabs, scratch, slabs
from cvkern.kernels.warp._zeros import clear

from . import _votes_cpu as cpu
from ._space import (
    Ballot,
    Cells,
    active_words,
    ballot_of,
    bin_of,
    cell_of,
    cells_of,
    factor_of,
    kernel_at,
    scaled,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

KERNEL_ONE = wp.constant(wp.int64(codes.KERNEL_ONE))
# Votes of a word, and votes that a maximum sees, roughly: for the number of threads only.
VOTES_OF_WORD, VOTES_OF_MODE = 32, 1024


def count_votes(
    patches: Patches, occurrences: Occurrences, space: Space, sums: wp.array, starts: wp.array
) -> None:
    """Add up the votes of each of C cells, and list where the votes of each would begin.

    `starts` (C + 1,) ends with the number of all votes. One thread a patch; then one adds up.
    """
    clear(sums)
    clear(starts)
    _cast(patches, occurrences, space, 0, starts, [sums, starts, None, None])
    wp.utils.array_scan(starts, starts, inclusive=True)


def list_votes(
    patches: Patches,
    occurrences: Occurrences,
    space: Space,
    starts: wp.array,
    votes: wp.array,
    sources: wp.array,
) -> None:
    """List the votes of each cell, in any order: V rows of place, scale and weight.

    `sources` (V, 2) has the patch and the occurrence of each. One thread a patch.
    """
    counts = scratch("recognition.counts", starts.shape, wp.int32, starts.device)
    clear(counts)
    _cast(patches, occurrences, space, 1, starts, [counts, counts, votes, sources])


def _cast(
    patches: Patches,
    occurrences: Occurrences,
    space: Space,
    listing: int,
    starts: wp.array,
    outputs: list,
) -> None:
    ballot = ballot_of(patches, occurrences, space, listing, starts)
    if starts.device.is_cuda:
        launch(_cast_word, patches.matches.size, [ballot], outputs)
        return
    bins, device = space.bins.shape[0], starts.device
    words, entries = occurrences.starts.shape[0], occurrences.entries.shape[0]
    parts = slabs(bins, patches.matches.size * VOTES_OF_WORD)
    firsts = scratch("recognition.firsts", (parts, words), wp.int32, device)
    live = scratch("recognition.live", (parts, 5, entries + cpu.LANES), wp.int32, device)
    launch_slabs(cpu.cast_bins, bins, parts, [ballot, firsts, live], outputs)


@wp.func
def vote(
    c: int,
    weight: int,
    source: wp.vec2i,
    place: wp.vec3i,
    ballot: Ballot,
    sums: wp.array[int],
    counts: wp.array[int],
    votes: wp.array2d[int],
    sources: wp.array2d[int],
):
    """Count a vote in a cell, or list it."""
    if ballot.listing == 0:
        wp.atomic_add(sums, c, weight)
        wp.atomic_add(counts, c + 1, 1)
    else:
        at = ballot.starts[c] + wp.atomic_add(counts, c, 1)
        for k in range(3):
            votes[at, k] = place[k]
        votes[at, 3] = weight
        sources[at, 0] = source[0]
        sources[at, 1] = source[1]


@wp.kernel
def _cast_word(
    ballot: Ballot,
    # outputs
    sums: wp.array[int],
    counts: wp.array[int],
    votes: wp.array2d[int],  # (V, 4)
    sources: wp.array2d[int],  # (V, 2)
):
    item = wp.tid()
    i = item // ballot.matches.shape[1]
    word = ballot.matches[i, item - i * ballot.matches.shape[1]]
    if word < 0:
        return
    active = active_words(ballot.matches, i)
    factor = factor_of(ballot.factors, ballot.lowest, ballot.places[i, 2])
    for e in range(ballot.begins[word], ballot.begins[word + 1]):
        scale = ballot.places[i, 2] + ballot.entries[e, 2]
        y = ballot.places[i, 0] + scaled(ballot.entries[e, 0], factor)
        x = ballot.places[i, 1] + scaled(ballot.entries[e, 1], factor)
        c = cell_of(ballot.bins, bin_of(ballot.bins, scale, ballot.slack), y, x)
        if c >= 0:
            weight = ballot.entries[e, 3] // active
            source = wp.vec2i(i, e)
            place = wp.vec3i(y, x, scale)
            vote(c, weight, source, place, ballot, sums, counts, votes, sources)


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


def shift_modes(
    votes: wp.array,
    starts: wp.array,
    space: Space,
    window: Window,
    maxima: wp.array,
    modes: wp.array,
) -> None:
    """Move each of T maxima to a mode of the votes' density by mean shift; a thread each.

    The kernel of Epanechnikov, 1 - d^2, grows with the scale of the place: its gradient leads to
    the mean of the votes within. `modes` (T, 4) are row, column, scale and density.
    """
    count = maxima.shape[0]
    if modes.device.is_cuda:
        launch(_shift, count, [cells_of(votes, starts, space), *window, maxima], [modes])
        return
    parts = slabs(count, count * VOTES_OF_MODE)
    inputs = [cells_of(votes, starts, space), *window, maxima]
    launch_slabs(cpu.shift, count, min(count, 8 * parts) if parts > 1 else 1, inputs, [modes])


@wp.struct
class Sums:
    """Sums over the votes in a kernel: weights, weighted places, and the density."""

    mass: wp.int64
    down: wp.int64
    along: wp.int64
    deep: wp.int64
    density: wp.int64


@wp.func
def sums_within(
    cells: Cells,
    place: wp.vec3i,
    reach: int,
    scales: int,
) -> Sums:
    """Return sums over the votes whose kernel is above 0."""
    found = Sums()
    y = place[0]
    x = place[1]
    z = place[2]
    for s in range(cells.bins.shape[0]):
        if wp.abs(cells.bins[s, 3] - z) <= scales + cells.slack:
            side = cells.bins[s, 4]
            columns = cells.bins[s, 2]
            above = wp.max(y - reach, 0) // side
            below = wp.min((y + reach) // side + 1, cells.bins[s, 1])
            before = wp.min(wp.max(x - reach, 0) // side, columns)
            behind = wp.max(wp.min((x + reach) // side + 1, columns), before)
            for row in range(above, below):
                cell = cells.bins[s, 0] + row * columns
                for v in range(cells.starts[cell + before], cells.starts[cell + behind]):
                    other = wp.vec3i(cells.votes[v, 0], cells.votes[v, 1], cells.votes[v, 2])
                    height = kernel_at(other - place, reach, scales)
                    if height > wp.int64(0):
                        weight = wp.int64(cells.votes[v, 3])
                        found.mass += weight
                        found.down += weight * wp.int64(cells.votes[v, 0])
                        found.along += weight * wp.int64(cells.votes[v, 1])
                        found.deep += weight * wp.int64(cells.votes[v, 2] - cells.lowest)
                        found.density += weight * height
    return found


@wp.func
def mean(sum: wp.int64, mass: wp.int64) -> int:
    """Return a quotient, halves rounded up."""
    return int((wp.int64(2) * sum + mass) // (wp.int64(2) * mass))


@wp.kernel
def _shift(
    cells: Cells,
    radius: int,
    scales: int,
    rounds: int,
    maxima: wp.array2d[int],  # (T, 4)
    # outputs
    modes: wp.array2d[int],  # (T, 4)
):
    t = wp.tid()
    place = wp.vec3i(maxima[t, 0], maxima[t, 1], maxima[t, 2])
    density = wp.int64(0)
    moving = maxima[t, 3] > 0
    left = rounds + 1
    while moving and left > 0:
        left -= 1
        reach = scaled(radius, factor_of(cells.factors, cells.lowest, place[2]))
        found = sums_within(cells, place, reach, scales)
        density = found.density
        moving = False
        if found.mass > wp.int64(0) and left > 0:
            other = wp.vec3i(
                mean(found.down, found.mass),
                mean(found.along, found.mass),
                mean(found.deep, found.mass) + cells.lowest,
            )
            for k in range(3):
                if other[k] != place[k]:
                    moving = True
            place = other
    for k in range(3):
        modes[t, k] = place[k]
    modes[t, 3] = int(density // KERNEL_ONE)
