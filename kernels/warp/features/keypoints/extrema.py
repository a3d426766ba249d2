"""Extrema of a scale space in Warp.

The Taichi set has the rules. On the CPU a thread takes a slab of rows (_extrema_cpu.h); rows are
smoothed two at a time (_smoothing_cpu.h). On CUDA a block smooths a tile (_smoothing_cuda.py), and
a warp compares 32 columns (_extrema_cuda.py).
"""

from collections.abc import Sequence

import warp as wp

from cvkern.kernels.codes.features import Limits
from cvkern.kernels.warp._launch import launch, launch_slabs, scratch, slabs
from cvkern.kernels.warp._replays import repeat
from cvkern.kernels.warp._sums import scan
from cvkern.kernels.warp._zeros import clear
from cvkern.kernels.warp.features._levels import level_of, rows_of, table
from cvkern.kernels.warp.features._marks import list_marks

from . import _extrema_cpu as cpu
from . import _extrema_cuda as cuda
from . import _smoothing_cuda as cuda_smoothing
from ._smoothing_cpu import fill_level, fill_levels
from .refinement import refine

# Extrema that CUDA queues: at least so many, and one of so many elements of all levels.
LEAST, SHARE = 1 << 14, 256


def prepare(src: wp.array, scale: float, dst: wp.array) -> None:
    """Grey values of bytes or floats, times `scale`; one thread a pixel."""
    if dst.device.is_cuda:
        launch(cuda.grays[src.dtype], dst.shape, [src, scale], [dst])
        return
    launch_slabs(
        cpu.gray_rows[src.dtype], dst.shape[0], slabs(dst.shape[0], dst.size), [src, scale], [dst]
    )


def double(src: wp.array, dst: wp.array) -> None:
    """Twice the size, by means between the pixels; one thread a pixel of the smaller image."""
    if dst.device.is_cuda:
        launch(cuda.double, src.shape, [src], [dst])
        return
    launch_slabs(cpu.double_row, dst.shape[0], slabs(dst.shape[0], dst.size), [src], [dst])


def fill_octaves(src: wp.array, taps: Sequence[wp.array], octaves: Sequence[wp.array]) -> None:
    """Smooth an image to the first level of the first octave, and each level to the next one.

    An octave begins with every second pixel of the larger one's level that is third from its end.
    Symmetric taps are applied down the rows and then along the columns, mirrored: the first ones
    to the image, the others to the levels. On the CPU the levels of an octave follow each other
    through the cache; CUDA does levels of several octaves together, and repeats a graph.
    """
    if src.device.is_cuda:
        jobs = cuda_smoothing.jobs_of(src, taps, octaves)
        arrays = [src, *taps, *octaves, jobs.table]
        repeat("fill_octaves", lambda: cuda_smoothing.fill(jobs), arrays)
        return
    for o, octave in enumerate(octaves):
        level = level_of(octave, 0)
        if o:
            before = octaves[o - 1]
            _halve(level_of(before, before.shape[0] - 3), level)
        else:
            fill_level(src, taps[0], level)
        fill_levels(taps, octave)


def _halve(src: wp.array, dst: wp.array) -> None:
    launch_slabs(cpu.halve_row, dst.shape[0], slabs(dst.shape[0], dst.size), [src], [dst])


def mark_keypoints(
    octaves: Sequence[wp.array],
    limits: Limits,
    margin: int,
    words: wp.array,
    ends: wp.array,
) -> None:
    """Mark the pixels to which fits move the extrema among 26 neighbours, if they are kept.

    A bit a pixel of the inner levels of all octaves, rows of words one after the other, and their
    number up to the end of each row.
    """
    if words.device.is_cuda:
        clear(words)
        clear(ends)
        device, pixels = words.device, sum(octave.size for octave in octaves)
        queue = scratch("keypoints.queue", (max(LEAST, pixels // SHARE), 4), wp.int32, device)
        number = scratch("keypoints.number", (1,), wp.int32, device)
        clear(number)
        mark, tables = cuda.mark(octaves[0].shape[0] - 3), table(octaves)
        inputs = [tables, limits.threshold, margin]
        launch(mark, cuda.threads(octaves, margin), inputs, [queue, number], cuda.BLOCK)
        inputs = [tables, *limits, margin, queue, number]
        launch(cuda.move, cuda.MOVING, inputs, [words, ends])
        scan(ends)
        return
    for levels, (marks, _, counts) in zip(octaves, rows_of(octaves, words, ends), strict=True):
        inputs = [levels, limits.threshold, margin]
        height = levels.shape[1]
        launch_slabs(cpu.mark_row, height, slabs(height, levels.size), inputs, [marks, counts])
    scan(ends)
    total = int(ends.numpy()[-1])
    cells = scratch("keypoints.extrema", (max(total, 1), 4), wp.int32, words.device)[:total]
    list_marks(octaves, words, ends, cells)
    offsets = scratch("keypoints.fits", (max(total, 1), 4), wp.float32, words.device)[:total]
    if total:
        refine(octaves, limits.contrast, limits.edge, margin, offsets, cells)
    clear(words)
    clear(ends)
    if total:
        launch(cpu.keep, 1, [table(octaves), cells], [words, ends])
    scan(ends)


def list_keypoints(
    octaves: Sequence[wp.array], words: wp.array, ends: wp.array, cells: wp.array
) -> None:
    """List octave, level, row and column of the N marks, in this order; one thread a row."""
    list_marks(octaves, words, ends, cells)
