"""The generalised Hough transform, in Warp.

A slice is the accumulator of one rotation and one scale. On the CPU a thread takes slice after
slice; on CUDA a block has a slice, or a part of one, in shared memory.
"""

import math

import warp as wp

from cvkern.kernels.codes.hough import DIRECTIONS
from cvkern.kernels.warp._launch import launch, launch_slabs, scratch, slabs, view

from . import _edge_directions as edge_points
from . import _votes_cpu as cpu
from . import _votes_cuda as cuda


def code_directions(points: wp.array, dy: wp.array, dx: wp.array, codes: wp.array) -> None:
    """Code the direction of the gradient at each point; one thread a point."""
    launch(edge_points.code_directions, codes.size, [points, dy, dx], [codes])


def search(
    points: wp.array,
    starts: wp.array,
    vectors: wp.array,
    directions: wp.array,
    turns: wp.array,
    scales: wp.array,
    tolerance: int,
    height: int,
    width: int,
    shift: int,
    keys: wp.array,
) -> None:
    """Find the cell of most votes in each tile of each slice."""
    _vote(
        points, starts, vectors, directions, turns, scales, tolerance, height, width, shift,
        True, keys,
    )  # fmt: skip


def accumulate(
    points: wp.array,
    starts: wp.array,
    vectors: wp.array,
    directions: wp.array,
    turns: wp.array,
    scales: wp.array,
    tolerance: int,
    height: int,
    width: int,
    shift: int,
    votes: wp.array,
) -> None:
    """Count the votes of each cell of each slice."""
    _vote(
        points, starts, vectors, directions, turns, scales, tolerance, height, width, shift,
        False, votes,
    )  # fmt: skip


def _vote(
    points: wp.array,
    starts: wp.array,
    vectors: wp.array,
    directions: wp.array,
    turns: wp.array,
    scales: wp.array,
    tolerance: int,
    height: int,
    width: int,
    shift: int,
    peaks: bool,
    found: wp.array,
) -> None:
    slices = turns.shape[0] * scales.shape[0]
    flat = view(found, wp.int32, (math.prod(found.shape),))
    inputs = [
        points, starts, vectors, directions, turns, scales, tolerance, height, width, shift,
    ]  # fmt: skip
    if points.device.is_cuda:
        kernel = cuda.search if peaks else cuda.accumulate
        deep, wide, number = cuda.rectangle(((height - 1) >> shift) + 1, ((width - 1) >> shift) + 1)
        launch(kernel, slices * number * cuda.BLOCK, [*inputs, deep, wide], [flat])
        return
    cells = (((height - 1) >> shift) + 2) * (((width - 1) >> shift) + 2) + cpu.LANES
    entries = directions.shape[0]
    pairs = points.shape[1] * entries * (2 * tolerance + 1) // (2 * DIRECTIONS)
    count = slabs(slices, slices * (pairs + cells))
    if count > 1:  # some directions have more points than others
        count = min(4 * count, slices)
    device = points.device
    windows = scratch("shapes.windows", (count * entries, 4), wp.int32, device)
    slab_cells = scratch("shapes.cells", (count, cells), wp.uint16, device)
    launch_slabs(cpu.search, slices, count, [count, *inputs, peaks, windows, slab_cells], [flat])
