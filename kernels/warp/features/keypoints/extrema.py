"""Extrema of a scale space in Warp.

The Taichi set has the rule. On the CPU a thread takes a slab of rows (_extrema_cpu.h); rows are
smoothed two at a time (_smoothing_cpu.h). On CUDA a thread takes a pixel (_extrema_cuda.py).
"""

from collections.abc import Sequence

import warp as wp

from cvkern.kernels.codes.filters import Border
from cvkern.kernels.warp._launch import launch, launch_slabs, scratch, slabs, view
from cvkern.kernels.warp._replays import repeat
from cvkern.kernels.warp._zeros import clear
from cvkern.kernels.warp.features._levels import level_of, rows_of
from cvkern.kernels.warp.features._marks import count_marks, list_marks
from cvkern.kernels.warp.filters.linear import correlate_separable

from . import _extrema_cpu as cpu
from . import _extrema_cuda as cuda
from ._smoothing_cpu import smooth_rows

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
    image, the others to the levels. On the CPU two rows are done together; CUDA repeats a graph.
    """
    if src.device.is_cuda:
        arrays = [src, *taps, *octaves]
        repeat("fill_octaves", lambda: _fill(src, taps, octaves), arrays)
    else:
        _fill(src, taps, octaves)


def _fill(src: wp.array, taps: Sequence[wp.array], octaves: Sequence[wp.array]) -> None:
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
    if words.device.is_cuda:
        clear(words)
    for levels, (marks, _, counts) in zip(octaves, rows_of(octaves, words, ends), strict=True):
        inputs = [levels, threshold, margin]
        height = levels.shape[1]
        if words.device.is_cuda:
            launch(cuda.mark, levels.shape[1:], inputs, [marks])
        else:
            launch_slabs(cpu.mark, height, slabs(height, levels.size), inputs, [marks, counts])
    count_marks(octaves, words, ends)


def list_extrema(
    octaves: Sequence[wp.array], words: wp.array, ends: wp.array, cells: wp.array
) -> None:
    """List octave, level, row and column of the N marks, in this order; one thread a row."""
    list_marks(octaves, words, ends, cells)
