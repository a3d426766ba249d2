"""Smoothing of the levels of a scale space on CUDA: both passes in one launch, levels side by side.

The code (_smoothing_cuda.cu) is native: a column of elements stays in registers, and a tile of sums
in shared memory. Two passes of plain Warp read and write each level twice.
"""

from collections.abc import Sequence
from typing import NamedTuple

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import launch
from cvkern.kernels.warp.features._levels import kept_table, level_of

# Blocks are numbered along one axis.
wp.set_module_options({"enable_backward": False, "fuse_fp": False, "default_grid_stride": False})

WORDS = 8  # numbers of a job
# Columns and rows of a tile, and blocks for a multiprocessor. A thread has a column with the reach
# of the taps on both sides in registers.
LARGE, SMALL = (256, 16, 3), (128, 4, 6)
NARROW = 24  # largest reach for small tiles
FILLED = 384  # tiles that fill a GPU: where there are fewer, smaller ones end sooner


def _smooth(columns: int, rows: int, blocks: int) -> wp.Kernel:
    """Return the kernel for tiles of one shape."""

    @_native.kernel(
        "_smoothing_cuda.cu", launch_bounds=(columns, blocks), COLUMNS=columns, ROWS=rows,
        WORDS=WORDS,
    )  # fmt: skip
    def smooth(first: int, jobs: wp.array2d[wp.int64]): ...  # (J, WORDS)

    return smooth


kernels = {tile: _smooth(*tile) for tile in (LARGE, SMALL)}


class Jobs(NamedTuple):
    """Images to smooth, in rounds of which each needs those before."""

    table: wp.array  # (J, WORDS) int64
    rounds: list[tuple[tuple[int, int, int], int, int]]  # tile, first job, number of blocks


def jobs_of(src: wp.array, taps: Sequence[wp.array], octaves: Sequence[wp.array]) -> Jobs:
    """Return the jobs that smooth an image to the first level, and each level to the next one.

    The level that is third from the end of an octave is written at half its size as well, to the
    first level of the next octave: that octave need not wait for the last levels.
    """
    rounds: dict[int, list[list[int]]] = {}
    for o, octave in enumerate(octaves):
        inner = octave.shape[0] - 3
        for i in range(1 if o else 0, octave.shape[0]):
            before = level_of(octave, i - 1) if i else src
            half = octaves[o + 1].ptr if i == inner and o + 1 < len(octaves) else 0
            height, width = octave.shape[1:]
            reach = taps[i].shape[0] // 2
            job = [before.ptr, level_of(octave, i).ptr, half, height, width,
                   taps[i].ptr + 4 * reach, reach]  # fmt: skip
            rounds.setdefault(inner * o + i, []).append(job)
    rows, told = [], []
    for number in sorted(rounds):
        group = rounds[number]
        few = sum(_blocks(job, LARGE) for job in group) < FILLED
        tile = SMALL if few and max(job[6] for job in group) <= NARROW else LARGE
        blocks = [_blocks(job, tile) for job in group]
        told.append((tile, len(rows), sum(blocks)))
        rows += [[*job, count] for job, count in zip(group, blocks, strict=True)]
    return Jobs(kept_table(rows, src.device), told)


def _blocks(job: list[int], tile: tuple[int, int, int]) -> int:
    """Return the number of tiles of a job."""
    height, width, reach = job[3], job[4], job[6]
    columns, rows, _ = tile
    return -(-width // (columns - 2 * (-(-reach // 4) * 4))) * -(-height // rows)


def fill(jobs: Jobs) -> None:
    """Smooth all levels; a block takes a tile."""
    for tile, first, blocks in jobs.rounds:
        launch(kernels[tile], blocks * tile[0], [first], [jobs.table], tile[0])
