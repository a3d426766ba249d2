"""Marks of pixels: bits of words, counted and listed in the order of their places."""

from collections.abc import Sequence

import warp as wp

from cvkern.kernels.warp._launch import BLOCK, launch, launch_each
from cvkern.kernels.warp._sums import scan

from . import _marks_cuda as cuda
from ._levels import BITS, place_of, table

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


def count_marks(octaves: Sequence[wp.array], words: wp.array, ends: wp.array) -> None:
    """Count the marks up to the end of each row; on the CPU those of each row are counted."""
    if ends.device.is_cuda:
        launch(_count, ends.shape[0], [table(octaves), words], [ends])
    scan(ends)


def list_marks(
    octaves: Sequence[wp.array], words: wp.array, ends: wp.array, cells: wp.array
) -> None:
    """List octave, level, row and column of the marks; a thread or a warp a row."""
    rows = ends.shape[0]
    if ends.device.is_cuda:
        inputs = [table(octaves), words, ends]
        launch(cuda.list_rows, cuda.LANES * rows, inputs, [cells], BLOCK)
        return
    launch_each(_list, rows, 32 * words.size, [table(octaves), words, ends], [cells])


@wp.kernel
def _count(
    octaves: wp.array2d[wp.int64],  # (O, 4)
    words: wp.array[int],
    # outputs
    counts: wp.array[int],  # (rows,)
):
    row = wp.tid()
    place = place_of(octaves, row)
    total = int(0)
    for k in range(place[4]):
        total += int(wp.bit_count(wp.uint32(words[place[3] + k])))
    counts[row] = total


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
                word = wp.uint32(words[place[3] + k])
                while word != wp.uint32(0):
                    rest = word & (word - wp.uint32(1))  # without its lowest bit
                    cells[at, 0] = place[0]
                    cells[at, 1] = place[1]
                    cells[at, 2] = place[2]
                    cells[at, 3] = k * BITS + int(wp.bit_count((word ^ rest) - wp.uint32(1)))
                    word = rest
                    at += 1
