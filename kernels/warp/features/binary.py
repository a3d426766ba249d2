"""FAST corners and binary descriptors, in Warp.

The Taichi set has the rules. On the CPU a thread takes a slab of rows or of corners
(_binary_cpu.h). On CUDA it takes a pixel to find corners (_binary_cuda.py), or a corner to measure
and describe it.
"""

from collections.abc import Sequence

import warp as wp

from cvkern.kernels.warp._launch import launch, launch_slabs, scratch, slabs
from cvkern.kernels.warp._zeros import clear

from . import _binary_cpu as cpu
from . import _binary_cuda as cuda
from ._levels import rows_of, table
from ._marks import count_marks, list_marks

SCORES = 64  # pixels whose scores the CPU finds at once


def round_values(src: wp.array, dst: wp.array) -> None:
    """Bytes of values: rounded and cut off; one thread a pixel."""
    if dst.device.is_cuda:
        launch(cuda.round_values, dst.shape, [src], [dst])
        return
    launch_slabs(cpu.round_values, dst.shape[0], slabs(dst.shape[0], dst.size), [src], [dst])


def mark_corners(
    images: Sequence[wp.array], threshold: int, margin: int, words: wp.array, ends: wp.array
) -> None:
    """Mark FAST corners of 9 pixels of 16 that score most of 3 x 3, of equal ones the first.

    A bit a pixel of all sizes of the image, rows of words one after the other, and their number up
    to the end of each row.
    """
    if words.device.is_cuda:
        clear(words)
    for src, (marks, _, counts) in zip(images, rows_of(images, words, ends), strict=True):
        height, width = src.shape
        if words.device.is_cuda:
            scores = scratch("corners.scores", src.shape, wp.uint8, src.device)
            launch(cuda.score, src.shape, [src, threshold, margin], [scores])
            launch(cuda.mark, src.shape, [scores], [marks])
            continue
        parts = slabs(height, src.size)
        pitch = (-(-width // SCORES) + 2) * SCORES
        lines = scratch("corners.lines", (3 * parts, pitch), wp.uint8, src.device)
        inputs = [src, threshold, margin, lines]
        launch_slabs(cpu.mark, height, parts, inputs, [marks, counts])
    count_marks(images, words, ends)


def list_corners(
    images: Sequence[wp.array],
    words: wp.array,
    ends: wp.array,
    cells: wp.array,
    responses: wp.array,
) -> None:
    """List size, 1, row and column of the N marks, in this order, with Harris' measure of each.

    It is that over 7 x 7 pixels, times 25, as an integer.
    """
    count = cells.shape[0]
    if words.device.is_cuda:
        list_marks(images, words, ends, cells)
        launch(cuda.weigh, count, [table(images), cells], [responses])
        return
    for n, (src, (marks, row, _)) in enumerate(
        zip(images, rows_of(images, words, ends), strict=True)
    ):
        height = src.shape[0]
        inputs = [src, marks, ends, n, row]
        launch_slabs(cpu.gather, height, slabs(height, src.size), inputs, [cells, responses])


def describe_corners(
    images: Sequence[wp.array],
    taps: wp.array,
    cells: wp.array,
    pattern: wp.array,
    upright: int,
    angles: wp.array,
    descriptors: wp.array,
) -> None:
    """Direction by the moments of a disc, bits by comparing pairs of pixels, smoothed by `taps`.

    Cells are as `list_corners` lists them. On the CPU a thread a point, on CUDA a block.
    """
    count = cells.shape[0]
    inputs = [table(images), taps, cells, pattern, upright]
    outputs = [angles, descriptors]
    if cells.device.is_cuda:
        launch(cuda.describe, count * cuda.THREADS, inputs, outputs, cuda.THREADS)
        return
    launch_slabs(cpu.describe, count, slabs(count, 4000 * count), inputs, outputs)
