"""Marks of pixels: bits of words, counted and listed in the order of their places."""

from collections.abc import Iterator, Sequence

import numpy as np
import taichi as ti

from cvkern.kernels.codes.features import WORD

i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
i32_3 = ti.types.ndarray(dtype=ti.i32, ndim=3)


def rows_of(octaves: Sequence[np.ndarray], words: np.ndarray) -> Iterator[tuple[np.ndarray, slice]]:
    """Yield the words of each octave, (levels, H, ceil(W / 32)), and its part of all rows.

    The inner levels of an octave (L, H, W) are marked, L - 3 of them; an image (H, W) is one.
    """
    word = row = 0
    for octave in octaves:
        *levels, height, width = octave.shape
        shape = (levels[0] - 3 if levels else 1, height, -(-width // WORD))
        count = shape[0] * height
        yield words[word : word + count * shape[2]].reshape(shape), slice(row, row + count)
        word, row = word + count * shape[2], row + count


def count_marks(octaves: Sequence[np.ndarray], words: np.ndarray, ends: np.ndarray) -> None:
    """Count the marks up to the end of each row: one thread a row, then a sum by one thread."""
    for marks, rows in rows_of(octaves, words):
        _count(marks, ends[rows])
    _add_up(ends)


@ti.kernel
def _count(
    words: i32_3,
    # outputs
    counts: i32_1,
):
    for row in counts:
        s = row // words.shape[1]
        y = row - s * words.shape[1]
        total = 0
        for k in range(words.shape[2]):
            total += ti.math.popcnt(words[s, y, k])
        counts[row] = total


@ti.kernel
def _add_up(
    # in place
    ends: i32_1,
):
    for _ in range(1):
        total = 0
        for row in range(ends.shape[0]):
            total += ends[row]
            ends[row] = total


def list_marks(
    octaves: Sequence[np.ndarray], words: np.ndarray, ends: np.ndarray, cells: np.ndarray
) -> None:
    """List octave, level, row and column of the marks; one thread a row."""
    for o, (marks, rows) in enumerate(rows_of(octaves, words)):
        _list(marks, o, rows.start, ends, cells)


@ti.kernel
def _list(
    words: i32_3,  # (levels, H, K)
    octave: ti.i32,
    first: ti.i32,
    ends: i32_1,
    # outputs
    cells: i32_2,  # (N, 4)
):
    for s, y in ti.ndrange(words.shape[0], words.shape[1]):
        row = first + s * words.shape[1] + y
        at = 0
        if row > 0:
            at = ends[row - 1]
        if at < ends[row]:
            for k in range(words.shape[2]):
                word = words[s, y, k]
                if word != 0:
                    for bit in range(WORD):
                        if (word >> bit) & 1 == 1:
                            cells[at, 0] = octave
                            cells[at, 1] = s + 1
                            cells[at, 2] = y
                            cells[at, 3] = k * WORD + bit
                            at += 1
