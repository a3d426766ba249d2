"""All octaves of a scale space in one table, so that one launch serves the points of all."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from cvkern.kernels.codes.features import WORD
from cvkern.kernels.warp._internals import view_at

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BITS = wp.constant(WORD)
place_t = wp.types.vector(5, wp.int32)
_MOST_TABLES = 16

_tables: dict[tuple, wp.array] = {}


def table(octaves: Sequence[wp.array]) -> wp.array:
    """Return address, levels, height and width of each octave: (O, 4), int64, on their device."""
    device = octaves[0].device
    key = (device.alias, *((octave.ptr, octave.shape) for octave in octaves))
    found = _tables.get(key)
    if found is None:
        if len(_tables) >= _MOST_TABLES:
            _tables.clear()
        rows = np.array([[octave.ptr, *octave.shape] for octave in octaves], np.int64)
        found = _tables[key] = wp.array(rows, dtype=wp.int64, device=device)
        wp.synchronize_device(device)  # the copy is on another stream than its readers
    return found


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

    The rows of all inner levels of all octaves are counted; level 1 is the first inner one.
    """
    o = int(0)
    left = row
    word = int(0)
    while left >= (int(octaves[o, 1]) - 3) * int(octaves[o, 2]):
        rows = (int(octaves[o, 1]) - 3) * int(octaves[o, 2])
        word += rows * ((int(octaves[o, 3]) + BITS - 1) // BITS)
        left -= rows
        o += 1
    words = (int(octaves[o, 3]) + BITS - 1) // BITS
    height = int(octaves[o, 2])
    s = left // height
    return place_t(o, s + 1, left - s * height, word + left * words, words)
