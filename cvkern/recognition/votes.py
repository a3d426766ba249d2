"""Votes of patches for objects, and the modes of their density."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from cvkern._runtime import Runtime
from cvkern.features._elementary import exp2
from cvkern.kernels.codes.recognition import (
    FACTOR_BITS,
    FINE,
    OCTAVE,
    Occurrences,
    Patches,
    Space,
    Window,
)
from cvkern.recognition._kept import kept
from cvkern.recognition.patches import Sampled, scale_code

CELL = 4  # pixels of the model along the side of a cell of votes
TILE = 3  # cells along the side of a tile, of which the best place is followed up
RADIUS = 5.0  # pixels of the model: the kernel of mean shift
ROUNDS = 5  # steps of mean shift
MOST_MODES = 512  # maxima that are followed up, the highest
MARGIN = 2 * OCTAVE  # scales beyond those of the levels that have a factor
WIDEST = 2.0  # least spacing of scales that counts as one, octaves


class Votes(NamedTuple):
    """The votes of a picture, for kernels."""

    patches: Patches
    occurrences: Occurrences
    space: Space
    window: Window
    sums: Any
    """Sum of the weights in each cell, (C,) int32."""


@lru_cache(maxsize=32)
def layout(shape: tuple[int, int], scales: tuple[float, ...]) -> tuple[Space, Window, np.ndarray]:
    """Return, with host arrays, the accumulator of an image, the kernel, and the tiles (T, 5)."""
    codes = sorted(scale_code(scale) for scale in scales)
    apart = min(np.diff(codes), default=round(WIDEST * OCTAVE))
    lowest = codes[0] - MARGIN
    steps = np.arange(codes[-1] + MARGIN - lowest + 1) + lowest
    whole = np.floor(steps / OCTAVE)
    factors = exp2(steps / OCTAVE - whole) * 2.0**whole
    bins, tiles, first = [], [], 0
    for number, code in enumerate(codes):
        side = round(FINE * CELL * float(factors[code - lowest]))
        rows, columns = (-(-FINE * n // side) for n in shape)
        bins.append((first, rows, columns, code, side))
        first += rows * columns
        down, along = (np.arange(0, n, TILE) for n in (rows, columns))
        top, left = (a.ravel() for a in np.meshgrid(down, along, indexing="ij"))
        ends = np.minimum(top + TILE, rows), np.minimum(left + TILE, columns)
        tiles.append(np.column_stack([np.full(len(top), number), top, left, *ends]))
    parts = np.rint(factors * 2.0**FACTOR_BITS).astype(np.int32)
    space = Space(np.array(bins, np.int32), int(apart), parts, lowest)
    window = Window(round(FINE * RADIUS), max(int(1.5 * apart), 1), ROUNDS)
    return space, window, np.concatenate(tiles).astype(np.int32)


def factors_at(space: Space, scales: np.ndarray) -> np.ndarray:
    """Return sizes at scales, in parts of 2^16, from an accumulator on the host."""
    return space.factors[np.clip(scales - space.lowest, 0, len(space.factors) - 1)]


def activate(rt: Runtime, sampled: Sampled, words: np.ndarray, least: int, most: int) -> Patches:
    """Match patches with the words of a codebook; return what is voted with, for kernels."""
    count = len(sampled.places)
    products, matches = (
        rt.scratch(f"recognition.{name}", (count, most), np.int32)
        for name in ("products", "matches")
    )
    rt.recognition.codebook.match_words(sampled.patches, kept(rt, words), least, products, matches)
    places, rows, levels = (
        kept(rt, array) if sampled.grid else rt.send(f"recognition.{name}", array)
        for name, array in zip(("places", "rows", "levels"), sampled[:3], strict=True)
    )
    return Patches(places, rows, levels, matches)


def find_modes(
    rt: Runtime,
    patches: Patches,
    occurrences: Occurrences,
    shape: tuple[int, int],
    scales: Sequence[float],
) -> tuple[Votes, np.ndarray]:
    """Return the votes of patches, and their modes (T, 4) on the host."""
    space, window, tiles = layout(tuple(shape), tuple(scales))
    kernels = rt.recognition.votes
    cells = int((space.bins[:, 1] * space.bins[:, 2]).sum())
    space = Space(rt.constant(space.bins), space.slack, rt.constant(space.factors), space.lowest)
    sums = rt.scratch("recognition.cells", (cells,), np.int32)
    counts = rt.scratch("recognition.counts", (cells,), np.int32)
    starts = rt.scratch("recognition.starts", (cells + 1,), np.int32)
    kernels.count_votes(patches, occurrences, space, sums, counts)
    maxima = rt.scratch("recognition.maxima", (len(tiles), 4), np.int32)
    kernels.find_maxima(sums, space, kept(rt, tiles), maxima)
    highest = np.asarray(rt.to_numpy(maxima))
    highest = highest[strongest(highest[:, 3], MOST_MODES)]
    if not len(highest):
        return Votes(patches, occurrences, space, window, sums), highest
    sent = rt.send("recognition.highest", highest)
    kernels.mark_votes(sent, space, window, counts, starts)
    count = int(rt.to_numpy(starts[cells : cells + 1])[0])
    votes = rt.scratch("recognition.votes", (count, 4), np.int32)
    kernels.list_votes(patches, occurrences, space, starts, votes)
    modes = rt.scratch("recognition.modes", highest.shape, np.int32)
    kernels.shift_modes(votes, starts, space, window, sent, modes)
    found = Votes(patches, occurrences, space, window, sums)
    moved = np.asarray(rt.to_numpy(modes))
    return found, moved[distinct(moved)]


def strongest(values: np.ndarray, most: int) -> np.ndarray:
    """Return the indices of the largest values above 0, ascending; of equal ones, the first."""
    least = np.partition(values, -most)[-most] if len(values) > most else 0
    above = np.flatnonzero(values > max(least, 0))
    if least <= 0:
        return above
    equal = np.flatnonzero(values == least)[: most - len(above)]
    return np.sort(np.concatenate([above, equal]))


def distinct(modes: np.ndarray) -> np.ndarray:
    """Return the first index of each place and scale, in the order of rows, columns and scales."""
    row, column, scale = (modes[:, k].astype(np.int64) for k in range(3))
    key = ((row << 26) + column << 12) + scale  # |column| < 2^25 and |scale| < 2^11
    return np.unique(key, return_index=True)[1]
