"""Votes of words for centres of objects, in Taichi.

A patch with m words casts the weights of each word's occurrences, divided by m and rounded down.
Every sum is of integers, so that no order shows.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.recognition import (
    AROUND,
    FACTOR_BITS,
    KERNEL_ONE,
    NOBODY,
    Occurrences,
    Patches,
    Space,
    Window,
)
from cvkern.kernels.taichi._launch import primitive, scratch

i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
vec3i = ti.types.vector(3, ti.i32)


@ti.func
def _scaled(size: ti.i32, factor: ti.i32) -> ti.i32:
    """Return a size times a factor of scale, halves rounded up."""
    wide = ti.cast(size, ti.i64) * ti.cast(factor, ti.i64)
    return ti.cast((wide + (1 << (FACTOR_BITS - 1))) >> FACTOR_BITS, ti.i32)


@ti.func
def _below(size: ti.i32, factor: ti.i32) -> ti.i32:
    """Return size / factor in parts of 2^16, rounded down."""
    return ti.cast(ti.cast(size, ti.i64) * (1 << FACTOR_BITS) // factor, ti.i32)


@ti.func
def _factor(factors: ti.template(), lowest: ti.i32, scale: ti.i32) -> ti.i32:
    return factors[ti.min(ti.max(scale - lowest, 0), factors.shape[0] - 1)]


@ti.func
def _bin(bins: ti.template(), scale: ti.i32, slack: ti.i32) -> ti.i32:
    """Return the bin whose scale is nearest, the first of several, or -1 beyond the slack."""
    found = -1
    least = slack + 1
    for s in range(bins.shape[0]):
        apart = ti.abs(scale - bins[s, 3])
        if apart < least:
            least = apart
            found = s
    return found


@ti.func
def _cell(bins: ti.template(), s: ti.i32, y: ti.i32, x: ti.i32) -> ti.i32:
    """Return the cell of a place, or -1 outside of the image."""
    found = -1
    if s >= 0 and y >= 0 and x >= 0:
        row = y // bins[s, 4]
        column = x // bins[s, 4]
        if row < bins[s, 1] and column < bins[s, 2]:
            found = bins[s, 0] + row * bins[s, 2] + column
    return found


@ti.func
def _active(matches: ti.template(), i: ti.i32) -> ti.i32:
    """Return the number of words of a patch."""
    found = 0
    for m in range(matches.shape[1]):
        found += ti.cast(matches[i, m] != NOBODY, ti.i32)
    return found


@ti.func
def _kernel_at(apart: vec3i, reach: ti.i32, scales: ti.i32) -> ti.i64:
    """Return the kernel of Epanechnikov at a distance, at most 0 outside."""
    dy = ti.cast(apart[0], ti.i64)
    dx = ti.cast(apart[1], ti.i64)
    dz = ti.cast(apart[2], ti.i64)
    flat = KERNEL_ONE * (dy * dy + dx * dx) // (ti.cast(reach, ti.i64) * reach)
    return KERNEL_ONE - flat - KERNEL_ONE * dz * dz // (scales * scales)


@primitive
def count_votes(
    patches: Patches, occurrences: Occurrences, space: Space, sums: np.ndarray, counts: np.ndarray
) -> None:
    """Add up the weights of the votes for each of C cells, and count the votes."""
    places, _, _, matches = patches
    _count(places, matches, *occurrences, *space, sums, counts)


@ti.kernel
def _count(
    places: i32_2,
    matches: i32_2,
    begins: i32_1,
    entries: i32_2,
    bins: i32_2,
    slack: ti.i32,
    factors: i32_1,
    lowest: ti.i32,
    # outputs
    sums: i32_1,
    counts: i32_1,
):
    for c in range(sums.shape[0]):
        sums[c] = 0
        counts[c] = 0
    for i in range(places.shape[0]):
        factor = _factor(factors, lowest, places[i, 2])
        active = _active(matches, i)
        for m in range(active):
            word = matches[i, m]
            for e in range(begins[word], begins[word + 1]):
                s = _bin(bins, places[i, 2] + entries[e, 2], slack)
                y = places[i, 0] + _scaled(entries[e, 0], factor)
                x = places[i, 1] + _scaled(entries[e, 1], factor)
                c = _cell(bins, s, y, x)
                if c >= 0:
                    ti.atomic_add(sums[c], entries[e, 3] // active)
                    ti.atomic_add(counts[c], 1)


@primitive
def mark_votes(
    maxima: np.ndarray, space: Space, window: Window, counts: np.ndarray, starts: np.ndarray
) -> None:
    """List where the votes of each cell begin that is within `AROUND` cells of a maximum.

    Other cells have no room in `starts` (C + 1,), which ends with the number of votes. Every bin is
    marked that the kernel of mean shift reaches.
    """
    _mark(maxima, space.bins, window.scales + space.slack, counts, starts)
    _begin(starts)


@ti.kernel
def _mark(
    maxima: i32_2,  # (T, 4)
    bins: i32_2,
    reach: ti.i32,
    counts: i32_1,
    # outputs
    starts: i32_1,  # (C + 1,)
):
    for c in range(starts.shape[0]):
        starts[c] = 0
    for t in range(maxima.shape[0]):
        for s in range(bins.shape[0]):
            if maxima[t, 3] > 0 and ti.abs(bins[s, 3] - maxima[t, 2]) <= reach:
                row = maxima[t, 0] // bins[s, 4]
                column = maxima[t, 1] // bins[s, 4]
                for y in range(ti.max(row - AROUND, 0), ti.min(row + AROUND + 1, bins[s, 1])):
                    for x in range(
                        ti.max(column - AROUND, 0), ti.min(column + AROUND + 1, bins[s, 2])
                    ):
                        c = bins[s, 0] + y * bins[s, 2] + x
                        starts[c + 1] = counts[c]


@ti.kernel
def _begin(
    # outputs
    starts: i32_1,  # (C + 1,): counts from the second on before
):
    for _ in range(1):
        total = 0
        for c in range(starts.shape[0]):
            if c > 0:
                total += starts[c]
            starts[c] = total


@primitive
def list_votes(
    patches: Patches,
    occurrences: Occurrences,
    space: Space,
    starts: np.ndarray,
    votes: np.ndarray,
) -> None:
    """List the votes of each cell with room, in any order: V rows of place, scale and weight.

    Cells whose votes would lie behind the last row are left out.
    """
    places, _, _, matches = patches
    counts = scratch((starts.shape[0],), np.int32)
    _list(places, matches, *occurrences, *space, starts, counts, votes)


@ti.kernel
def _list(
    places: i32_2,
    matches: i32_2,
    begins: i32_1,
    entries: i32_2,
    bins: i32_2,
    slack: ti.i32,
    factors: i32_1,
    lowest: ti.i32,
    starts: i32_1,
    # outputs
    counts: i32_1,
    votes: i32_2,
):
    for c in range(counts.shape[0]):
        counts[c] = 0
    for i in range(places.shape[0]):
        factor = _factor(factors, lowest, places[i, 2])
        active = _active(matches, i)
        for m in range(active):
            word = matches[i, m]
            for e in range(begins[word], begins[word + 1]):
                scale = places[i, 2] + entries[e, 2]
                y = places[i, 0] + _scaled(entries[e, 0], factor)
                x = places[i, 1] + _scaled(entries[e, 1], factor)
                c = _cell(bins, _bin(bins, scale, slack), y, x)
                wanted = 0
                if c >= 0:
                    begin, end = starts[c], starts[c + 1]
                    wanted = ti.cast(end > begin and end <= votes.shape[0], ti.i32)
                if wanted == 1:
                    at = starts[c] + ti.atomic_add(counts[c], 1)
                    votes[at, 0] = y
                    votes[at, 1] = x
                    votes[at, 2] = scale
                    votes[at, 3] = entries[e, 3] // active
