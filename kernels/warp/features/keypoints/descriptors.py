"""Orientations and descriptors of keypoints in Warp.

The Taichi set has the rules. Histograms are sums of integers, so the order of the pixels has no
effect. On the CPU a thread takes a slab of points (_descriptors_cpu.h), on CUDA a row of a point's
window (_descriptors_cuda.py).
"""

import warp as wp

from cvkern.kernels.codes.features import BINS, ROOM
from cvkern.kernels.warp._launch import launch, launch_slabs, scratch, slabs
from cvkern.kernels.warp._zeros import clear

from . import _descriptors_cpu as cpu
from . import _descriptors_cuda as cuda

PIXELS = 2000  # pixels of a window, about: what slabs are cut by


def orient(
    levels: wp.array,
    cells: wp.array,
    spreads: wp.array,
    reach: int,
    one: float,
    angles: wp.array,
    counts: wp.array,
) -> None:
    """Find the directions of each point, in bins, by a histogram; a block of rows a point."""
    count = cells.shape[0]
    if levels.device.is_cuda:
        sums = scratch("keypoints.directions", (count, BINS), wp.int32, levels.device)
        clear(sums)
        votes = [levels, cells, spreads, one]
        launch(cuda.vote_directions, (count, 2 * reach + 1), votes, [sums])
        launch(cuda.pick_directions, count, [sums], [angles, counts])
        return
    inputs = [levels, cells, spreads, one]
    launch_slabs(cpu.orient, count, _parts(count), inputs, [angles, counts])


def describe(
    levels: wp.array,
    cells: wp.array,
    turns: wp.array,
    reach: int,
    one: float,
    root: int,
    descriptors: wp.array,
) -> None:
    """Describe each point by histograms of directions in 16 cells; a block of rows a point."""
    count = cells.shape[0]
    if levels.device.is_cuda:
        sums = scratch("keypoints.cells", (count, ROOM), wp.int32, levels.device)
        clear(sums)
        launch(cuda.vote_cells, (count, 2 * reach + 1), [levels, cells, turns, one], [sums])
        launch(cuda.normalise, count, [sums, root], [descriptors])
        return
    inputs = [levels, cells, turns, one, root]
    launch_slabs(cpu.describe, count, _parts(count), inputs, [descriptors])


def _parts(count: int) -> int:
    """Return several slabs a thread: windows differ in size."""
    return min(count, 4 * slabs(count, PIXELS * count))
