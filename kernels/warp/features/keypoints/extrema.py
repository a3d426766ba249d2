"""Extrema of a scale space in Warp.

The Taichi set has the rule. On the CPU a thread takes a slab of rows (_extrema_cpu.h); rows are
smoothed two at a time (_smoothing_cpu.h). On CUDA a thread takes a pixel (_extrema_cuda.py).
"""

import warp as wp

from cvkern.kernels.codes.filters import Border
from cvkern.kernels.warp._launch import launch, launch_slabs, scratch, slabs, view
from cvkern.kernels.warp._zeros import clear
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


def smooth(src: wp.array, taps: wp.array, dst: wp.array) -> None:
    """Correlate down the rows, then along the columns, mirrored; on the CPU over two rows."""
    height, width = src.shape
    if dst.device.is_cuda:
        one, other = (view(a, wp.float32, (1, height, width)) for a in (src, dst))
        correlate_separable(one, taps, taps, 1, int(Border.MIRROR), 0.0, other)
        return
    parts = slabs(height, src.size)
    margin = -(-taps.shape[0] // (2 * LINE)) * LINE
    lines = scratch("keypoints.rows", (2 * parts, width + 2 * margin), wp.float32, dst.device)
    launch_slabs(smooth_rows, height, parts, [src, taps, margin, lines], [dst])


def halve(src: wp.array, dst: wp.array) -> None:
    """Every second pixel of every second row; one thread a pixel."""
    if dst.device.is_cuda:
        launch(cuda.halve, dst.shape, [src], [dst])
        return
    launch_slabs(cpu.halve, dst.shape[0], slabs(dst.shape[0], dst.size), [src], [dst])


def mark_extrema(
    levels: wp.array, threshold: float, margin: int, words: wp.array, counts: wp.array
) -> None:
    """Mark pixels whose difference of levels is extreme among 26 neighbours.

    A bit a pixel, and their number in each row.
    """
    count, height, width = levels.shape
    if levels.device.is_cuda:
        clear(words)
        launch(cuda.mark, (count - 3, height, width), [levels, threshold, margin], [words])
        count_marks(words, counts)
        return
    parts = slabs(height, levels.size)
    launch_slabs(cpu.mark, height, parts, [levels, threshold, margin], [words, counts])


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
