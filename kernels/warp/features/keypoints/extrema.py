"""Extrema of a scale space in Warp.

The Taichi set has the rule. On the CPU a thread takes a slab of rows (_extrema_cpu.h); rows are
smoothed two at a time (_smoothing_cpu.h). On CUDA a thread takes a pixel (_extrema_cuda.py).
"""

import math
from collections.abc import Sequence

import warp as wp

from cvkern.kernels.codes.features import WORD
from cvkern.kernels.codes.filters import Border
from cvkern.kernels.warp._launch import launch, launch_each, launch_slabs, scratch, slabs, view
from cvkern.kernels.warp._sums import scan
from cvkern.kernels.warp._zeros import clear
from cvkern.kernels.warp.filters.linear import correlate_separable

from . import _extrema_cpu as cpu
from . import _extrema_cuda as cuda
from ._octaves import BITS, cut, level_of, place_of, table
from ._smoothing_cpu import smooth_rows

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

LINE = 16  # floats of a line of the cache


def prepare(src: wp.array, scale: float, dst: wp.array) -> None:
    """Grey values times `scale`; one thread a pixel."""
    if dst.device.is_cuda:
        launch(cuda.gray, dst.shape, [src, scale], [dst])
        return
    launch_slabs(cpu.gray, dst.shape[0], slabs(dst.shape[0], dst.size), [src, scale], [dst])


def double(src: wp.array, dst: wp.array) -> None:
    """Twice the size, by means between the pixels; one thread a pixel."""
    if dst.device.is_cuda:
        launch(cuda.double, dst.shape, [src], [dst])
        return
    launch_slabs(cpu.double, dst.shape[0], slabs(dst.shape[0], dst.size), [src], [dst])


def fill_octaves(src: wp.array, taps: Sequence[wp.array], octaves: Sequence[wp.array]) -> None:
    """Smooth an image to the first level of the first octave, and each level to the next one.

    An octave begins with every second pixel of the larger one's level that is third from its end.
    Taps are applied down the rows and then along the columns, mirrored: the first ones to the
    image, the others to the levels. On the CPU two rows are done together.
    """
    for o, octave in enumerate(octaves):
        level = level_of(octave, 0)
        if o:
            before = octaves[o - 1]
            _halve(level_of(before, before.shape[0] - 3), level)
        else:
            _smooth(src, taps[0], level)
        for i in range(1, octave.shape[0]):
            level, before = level_of(octave, i), level
            _smooth(before, taps[i], level)


def _smooth(src: wp.array, taps: wp.array, dst: wp.array) -> None:
    height, width = src.shape
    if dst.device.is_cuda:
        one, other = (view(a, wp.float32, (1, height, width)) for a in (src, dst))
        correlate_separable(one, taps, taps, 1, int(Border.MIRROR), 0.0, other)
        return
    parts = slabs(height, src.size)
    margin = -(-taps.shape[0] // (2 * LINE)) * LINE
    lines = scratch("keypoints.rows", (2 * parts, width + 2 * margin), wp.float32, dst.device)
    launch_slabs(smooth_rows, height, parts, [src, taps, margin, lines], [dst])


def _halve(src: wp.array, dst: wp.array) -> None:
    if dst.device.is_cuda:
        launch(cuda.halve, dst.shape, [src], [dst])
        return
    launch_slabs(cpu.halve, dst.shape[0], slabs(dst.shape[0], dst.size), [src], [dst])


def mark_extrema(
    octaves: Sequence[wp.array], threshold: float, margin: int, words: wp.array, ends: wp.array
) -> None:
    """Mark pixels whose difference of levels is extreme among 26 neighbours.

    A bit a pixel of the inner levels of all octaves, rows of words one after the other, and their
    number up to the end of each row.
    """
    on_cuda = words.device.is_cuda
    if on_cuda:
        clear(words)
    word = row = 0
    for levels in octaves:
        count, height, width = levels.shape
        shape = (count - 3, height, -(-width // WORD))
        marks = cut(words, word, shape)
        if on_cuda:
            inputs = [levels, threshold, margin]
            launch(cuda.mark, (count - 3, height, width), inputs, [marks])
        else:
            rows = cut(ends, row, (shape[0] * height,))
            inputs = [levels, threshold, margin]
            launch_slabs(cpu.mark, height, slabs(height, levels.size), inputs, [marks, rows])
        word += math.prod(shape)
        row += shape[0] * height
    if on_cuda:
        launch(cuda.count_all, row, [table(octaves), words], [ends])
    scan(ends)


def list_extrema(
    octaves: Sequence[wp.array], words: wp.array, ends: wp.array, cells: wp.array
) -> None:
    """List octave, level, row and column of the N marks, in this order; one thread a row."""
    rows = ends.shape[0]
    launch_each(_list, rows, 32 * words.size, [table(octaves), words, ends], [cells])


@wp.kernel
def _list(
    stride: int,
    first: int,
    last: int,
    octaves: wp.array2d[wp.int64],  # (O, 4)
    words: wp.array[int],
    ends: wp.array[int],  # (rows,)
    # outputs
    cells: wp.array2d[int],  # (N, 4)
):
    for row in range(first + wp.tid(), last, stride):
        at = int(0)
        if row > 0:
            at = ends[row - 1]
        if at < ends[row]:
            place = place_of(octaves, row)
            for k in range(place[4]):
                word = words[place[3] + k]
                if word != 0:
                    for bit in range(BITS):
                        if ((word >> bit) & 1) == 1:
                            cells[at, 0] = place[0]
                            cells[at, 1] = place[1]
                            cells[at, 2] = place[2]
                            cells[at, 3] = k * BITS + bit
                            at += 1


def count_marks(words: wp.array, counts: wp.array) -> None:
    """Count the bits of each row, on CUDA, where they were not counted when they were set."""
    rows = _rows(words)
    launch(cuda.count, rows.shape[0], [rows], [counts])


def list_marks(words: wp.array, starts: wp.array, width: int, places: wp.array) -> None:
    """List the places (row times `width` plus column) of the bits; one thread a row."""
    rows = _rows(words)
    if words.device.is_cuda:
        launch(cuda.gather, rows.shape[0], [rows, starts, width], [places])
        return
    parts = slabs(rows.shape[0], 32 * rows.size)
    launch_slabs(cpu.gather, rows.shape[0], parts, [rows, starts, width], [places])


def _rows(words: wp.array) -> wp.array:
    return view(words, wp.int32, (words.shape[0] * words.shape[1], words.shape[2]))
