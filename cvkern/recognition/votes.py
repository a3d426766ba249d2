"""Votes of patches for objects, and the modes of their density."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from cvkern._runtime import Runtime
from cvkern.features._elementary import exp2
from cvkern.kernels.codes.recognition import (
    FACTOR_BITS,
    FINE,
    OCTAVE,
    Space,
    Window,
)
from cvkern.recognition._kept import kept
from cvkern.recognition.patches import scale_code

CELL = 4  # pixels of the model along the side of a cell of votes
TILE = 3  # cells along the side of a tile, of which the best place is followed up
RADIUS = 5.0  # pixels of the model: the kernel of mean shift
ROUNDS = 5  # steps of mean shift
MARGIN = 2 * OCTAVE  # scales beyond those of the levels that have a factor
OVERHANG = 0.1  # part of the sides of a box that may stick out of the picture
WIDEST = 2.0  # least spacing of scales that counts as one, octaves


class Hall(NamedTuple):
    """Where votes for objects in an image are counted, for kernels."""

    space: Space
    window: Window
    tiles: Any
    """Cells of which the best place is followed up, (T, 5) int32."""
    spans: Any
    """Least row and column of a mode, and the largest, at each scale, (F, 4) int32."""
    sizes: Any
    """Scale, half the height and half the width of the box at each scale, (F, 3) float64."""


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


@lru_cache(maxsize=32)
def boxes_in(
    shape: tuple[int, int], scales: tuple[float, ...], box: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the spans of modes and the sizes of boxes at each scale; `Hall` describes them.

    A box of an object may extend beyond the image by `OVERHANG` of its sides.
    """
    space, _, _ = layout(shape, scales)
    size = 2.0 ** ((np.arange(len(space.factors)) + space.lowest)[:, None] / OCTAVE)
    half = size * np.array(box) / 2
    low = (1 - 2 * OVERHANG) * half - 0.5
    spans = np.concatenate([np.ceil(FINE * low), np.floor(FINE * (np.array(shape) - 1 - low))], 1)
    return spans.astype(np.int32), np.ascontiguousarray(np.concatenate([size, half], axis=1))


def hall_on(
    rt: Runtime, shape: tuple[int, int], scales: tuple[float, ...], box: tuple[int, int]
) -> Hall:
    """Return where votes for objects are counted, for kernels."""
    space, window, tiles = layout(shape, scales)
    space = space._replace(bins=kept(rt, space.bins), factors=kept(rt, space.factors))
    spans, sizes = boxes_in(shape, scales, box)
    return Hall(space, window, kept(rt, tiles), kept(rt, spans), kept(rt, sizes))


def activate(rt: Runtime, patches: Any, words: Any, least: int, matches: Any) -> None:
    """Match patches with the words of a codebook: `matches` (N, M) are the best of each."""
    products = rt.scratch("recognition.products", matches.shape, np.int32)
    rt.recognition.codebook.match_words(patches, words, least, products, matches)
