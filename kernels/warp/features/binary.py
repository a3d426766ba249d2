"""FAST corners and binary descriptors, in Warp.

The Taichi set has the rules. On the CPU a thread takes a slab of rows or of corners
(_binary_cpu.h). On CUDA it takes a pixel to find corners (_binary_cuda.py), or a corner to measure
and describe it.
"""

from collections.abc import Sequence
from itertools import pairwise

import warp as wp

from cvkern.kernels.warp._launch import launch, launch_slabs, scratch, slabs
from cvkern.kernels.warp._zeros import clear

from . import _binary_cpu as cpu
from . import _binary_cuda as cuda
from ._levels import rows_of, table
from ._marks import count_marks, list_marks

SCORES = 64  # pixels whose scores the CPU finds at once
ROWS = 32  # rows of a smaller size that the CPU makes together
PARTS = 4  # slabs of a thread; those of larger sizes take longer


def round_values(src: wp.array, dst: wp.array) -> None:
    """Bytes of values: rounded and cut off; one thread a pixel."""
    if dst.device.is_cuda:
        launch(cuda.round_values, dst.shape, [src], [dst])
        return
    launch_slabs(cpu.round_row, dst.shape[0], slabs(dst.shape[0], dst.size), [src], [dst])


def shrink(images: Sequence[wp.array], starts: wp.array, weights: wp.array) -> None:
    """Make images 1, 2, ..., each of the one before, down the rows, then along them.

    The starts and integer weights of the rows and columns of all images follow each other. On CUDA
    one thread an element and pass; on the CPU both passes are done together, over vectors.
    """
    if starts.device.is_cuda:
        first = 0
        for src, dst in pairwise(images):
            rows, end = (first, first + dst.shape[0]), first + sum(dst.shape)
            lines = scratch("shrink.lines", (rows[1] - first, src.shape[1]), wp.uint8, src.device)
            inputs = [src, starts[slice(*rows)], weights[slice(*rows)]]
            launch(cuda.shrink_down, lines.shape, inputs, [lines])
            inputs = [lines, starts[rows[1] : end], weights[rows[1] : end]]
            launch(cuda.shrink_along, dst.shape, inputs, [dst])
            first = end
        return
    groups = sum(-(-dst.shape[0] // ROWS) for dst in images[1:])
    shared = scratch("shrink.shared", (1 + groups,), wp.int32, starts.device)
    clear(shared)
    parts = _parts(images, groups)
    launch_slabs(cpu.shrink, groups, parts, [table(images), starts, weights], [shared])


def mark_corners(
    images: Sequence[wp.array], threshold: int, margin: int, words: wp.array, ends: wp.array
) -> None:
    """Mark FAST corners of 9 pixels of 16 that score most of 3 x 3, of equal ones the first.

    A bit a pixel of all sizes of the image, rows of words one after the other, and their number up
    to the end of each row.
    """
    if words.device.is_cuda:
        clear(words)
        for src, (marks, _, _) in zip(images, rows_of(images, words, ends), strict=True):
            scores = scratch("corners.scores", src.shape, wp.uint8, src.device)
            launch(cuda.score, src.shape, [src, threshold, margin], [scores])
            launch(cuda.mark, src.shape, [scores], [marks])
    else:
        parts = _parts(images, ends.shape[0])
        pitch = (-(-images[0].shape[1] // SCORES) + 2) * SCORES
        lines = scratch("corners.lines", (3 * parts, pitch), wp.uint8, words.device)
        inputs = [table(images), threshold, margin, lines]
        launch_slabs(cpu.mark, ends.shape[0], parts, inputs, [words, ends])
    count_marks(images, words, ends)


def _parts(images: Sequence[wp.array], rows: int) -> int:
    """Return the number of slabs of the rows of all images."""
    parts = slabs(rows, sum(src.size for src in images))
    return PARTS * parts if parts > 1 else 1


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
    if words.device.is_cuda:
        list_marks(images, words, ends, cells)
        launch(cuda.weigh, cells.shape[0], [table(images), cells], [responses])
        return
    inputs = [table(images), words, ends]
    launch_slabs(
        cpu.gather, ends.shape[0], _parts(images, ends.shape[0]), inputs, [cells, responses]
    )


def describe_corners(
    images: Sequence[wp.array],
    cells: wp.array,
    pattern: wp.array,
    upright: int,
    angles: wp.array,
    descriptors: wp.array,
) -> None:
    """Direction by the moments of a disc, bits by comparing pairs of smoothed pixels.

    Cells are as `list_corners` lists them. On the CPU a thread a point, on CUDA a block.
    """
    count = cells.shape[0]
    inputs = [table(images), cells, pattern, upright]
    outputs = [angles, descriptors]
    if cells.device.is_cuda:
        launch(cuda.describe, count * cuda.THREADS, inputs, outputs, cuda.THREADS)
        return
    launch_slabs(cpu.describe_one, count, slabs(count, 1000 * count), inputs, outputs)
