"""Octaves of a scale space, or sizes of an image, in one table: one launch serves all points."""

import threading
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import warp as wp

from cvkern.kernels.codes.features import WORD
from cvkern.kernels.warp._internals import view_at

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BITS = wp.constant(WORD)
place_t = wp.types.vector(5, wp.int32)
_MOST_TABLES = 32


class _Tables(threading.local):
    """Tables that this thread has sent, by their device and contents."""

    def __init__(self) -> None:
        self.kept: dict[tuple, wp.array] = {}


_thread = _Tables()


def table(octaves: Sequence[wp.array]) -> wp.array:
    """Return address, marked levels, height and width of each: (O, 4), int64, on their device.

    The marked levels of an octave (L, H, W) are the L - 3 inner ones; an image (H, W) is one.
    """
    rows = [[octave.ptr, *marked(octave)] for octave in octaves]
    return kept_table(rows, octaves[0].device)


def kept_table(rows: Sequence[Sequence[Any]], device: wp.Device) -> wp.array:
    """Return a table of addresses and sizes, int64; it is sent to its device once."""
    values = np.array(rows, np.int64)
    key = (device.alias, values.shape, values.tobytes())
    kept = _thread.kept
    found = kept.get(key)
    if found is None:
        if len(kept) >= _MOST_TABLES:
            for alias in {of for of, *_ in kept}:
                wp.synchronize_device(alias)  # kernels may still read them
            kept.clear()
        found = kept[key] = wp.array(values, dtype=wp.int64, device=device)
        wp.synchronize_device(device)  # the copy is on another stream than its readers
    return found


def marked(octave: wp.array) -> tuple[int, int, int]:
    """Return the number of levels whose pixels are marked, and their height and width."""
    *levels, height, width = octave.shape
    return (levels[0] - 3 if levels else 1), height, width


def rows_of(octaves: Sequence[wp.array], words: wp.array, ends: wp.array) -> Iterator[Any]:
    """Yield the words of each octave, (levels, H, ceil(W / 32)), its first row, and its ends."""
    word = row = 0
    for octave in octaves:
        levels, height, width = marked(octave)
        shape = (levels, height, -(-width // WORD))
        count = levels * height
        yield cut(words, word, shape), row, cut(ends, row, (count,))
        word, row = word + count * shape[2], row + count


def cut(array: wp.array, first: int, shape: tuple[int, ...]) -> wp.array:
    """View a part of an array of 4-byte elements, which the caller keeps alive."""
    return view_at((array.ptr or 0) + 4 * first, array.dtype, shape, array.device)


def level_of(octave: wp.array, level: int) -> wp.array:
    """View a level of an octave: (H, W)."""
    _, height, width = octave.shape
    return cut(octave, level * height * width, (height, width))


@wp.func
def place_of(octaves: wp.array2d[wp.int64], row: int) -> place_t:
    """Return octave, level, row, first word and number of words of a row of marks.

    The rows of all marked levels of all octaves are counted; the first such level is level 1.
    """
    o = int(0)
    left = row
    word = int(0)
    rows = int(octaves[0, 1]) * int(octaves[0, 2])
    while left >= rows:
        word += rows * ((int(octaves[o, 3]) + BITS - 1) // BITS)
        left -= rows
        o += 1
        rows = int(octaves[o, 1]) * int(octaves[o, 2])
    words = (int(octaves[o, 3]) + BITS - 1) // BITS
    height = int(octaves[o, 2])
    s = left // height
    return place_t(o, s + 1, left - s * height, word + left * words, words)
