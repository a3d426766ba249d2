"""Smoothing of the levels of a scale space on CUDA: both passes in one launch, levels side by side.

The code (_smoothing_cuda.cu) is native: a column of elements stays in registers, and a tile of sums
in shared memory. Two passes of plain Warp read and write each level twice.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import launch
from cvkern.kernels.warp.features._levels import kept_table, level_of

# Blocks are numbered along one axis.
wp.set_module_options({"enable_backward": False, "fuse_fp": False, "default_grid_stride": False})

COLUMNS = 256  # columns of a tile, and threads of a block
ROWS = 16  # rows of a tile: registers of a thread, with the reach of the taps on both sides
WORDS = 8  # numbers of a job


@_native.kernel(
    "_smoothing_cuda.cu", launch_bounds=(COLUMNS, 3), COLUMNS=COLUMNS, ROWS=ROWS, WORDS=WORDS
)
def smooth(first: int, jobs: wp.array2d[wp.int64]): ...  # (J, WORDS)


class Jobs(NamedTuple):
    """Images to smooth, in rounds of which each needs those before."""

    table: wp.array  # (J, WORDS) int64
    rounds: list[tuple[int, int]]  # first job, and number of blocks


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
            wide = COLUMNS - 2 * (-(-reach // 4) * 4)
            blocks = -(-width // wide) * -(-height // ROWS)
            job = [before.ptr, level_of(octave, i).ptr, half, height, width,
                   taps[i].ptr + 4 * reach, reach, blocks]  # fmt: skip
            rounds.setdefault(inner * o + i, []).append(job)
    groups = [rounds[n] for n in sorted(rounds)]
    table = kept_table([job for group in groups for job in group], src.device)
    firsts = np.cumsum([0] + [len(group) for group in groups]).tolist()
    return Jobs(table, [(f, sum(j[-1] for j in g)) for f, g in zip(firsts, groups, strict=False)])


def fill(jobs: Jobs) -> None:
    """Smooth all levels; a block takes a tile."""
    for first, blocks in jobs.rounds:
        launch(smooth, blocks * COLUMNS, [first], [jobs.table], COLUMNS)
