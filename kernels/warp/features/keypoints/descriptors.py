"""Orientations and descriptors of keypoints in Warp.

The Taichi set has the rules. Histograms are sums of integers, so the order of the pixels has no
effect. On the CPU a thread takes a slab of points (_descriptors_cpu.h), on CUDA a row of a point's
window (_descriptors_cuda.py).
"""

from collections.abc import Sequence

import warp as wp

from cvkern.kernels.warp._launch import launch, launch_slabs, slabs
from cvkern.kernels.warp.features._levels import table

from . import _descriptors_cpu as cpu
from . import _descriptors_cuda as cuda

PIXELS = 2000  # pixels of a window, about: what slabs are cut by


def orient(
    octaves: Sequence[wp.array],
    windows: wp.array,
    spreads: wp.array,
    one: float,
    angles: wp.array,
    counts: wp.array,
) -> None:
    """Find the directions of each point, in bins, by a histogram; on CUDA a block a point.

    A window is octave, level, row, column and radius; one of octave -1 has no directions.
    """
    count = windows.shape[0]
    inputs = [table(octaves), windows, spreads, one]
    if windows.device.is_cuda:
        launch(cuda.orient, count * cuda.THREADS, inputs, [angles, counts], cuda.THREADS)
        return
    launch_slabs(cpu.orient_one, count, _parts(count), inputs, [angles, counts])


def describe(
    octaves: Sequence[wp.array],
    windows: wp.array,
    turns: wp.array,
    one: float,
    root: int,
    descriptors: wp.array,
) -> None:
    """Describe each point by histograms of directions in 16 cells; on CUDA a block a point."""
    count = windows.shape[0]
    inputs = [table(octaves), windows, turns, one, root]
    if windows.device.is_cuda:
        launch(cuda.describe, count * cuda.THREADS, inputs, [descriptors], cuda.THREADS)
        return
    launch_slabs(cpu.describe_one, count, _parts(count), inputs, [descriptors])


def _parts(count: int) -> int:
    """Return several slabs a thread: windows differ in size."""
    return min(count, 4 * slabs(count, PIXELS * count))
