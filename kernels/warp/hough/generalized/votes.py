"""The generalised Hough transform, in Warp.

A slice is the accumulator of one rotation and one scale; _votes_cpu.py has the rule of the votes
and its source. On the CPU a thread takes slice after slice; on CUDA a block has a slice, or a part
of one, in shared memory.
"""

import math

import warp as wp

from cvkern.kernels.codes.hough import DIRECTIONS, Cells, Entries, Slices, Voters
from cvkern.kernels.warp._angles import atan2
from cvkern.kernels.warp._launch import launch, launch_each, launch_slabs, scratch, slabs, view
from cvkern.kernels.warp.hough._directions import direction_code

from . import _votes_cpu as cpu
from . import _votes_cuda as cuda
from ._ballot import ballot_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def _code_directions(
    stride: int,
    first: int,
    last: int,
    points: wp.array2d[int],  # (N, 2)
    dy: wp.array2d[float],  # (H, W)
    dx: wp.array2d[float],  # (H, W)
    # outputs
    codes: wp.array[int],  # (N,)
):
    for i in range(first + wp.tid(), last, stride):
        y = points[i, 0]
        x = points[i, 1]
        codes[i] = direction_code(atan2(dy[y, x], dx[y, x]))


def code_directions(points: wp.array, dy: wp.array, dx: wp.array, codes: wp.array) -> None:
    """Compute the direction code of each point; a thread takes a slab of points, or one point."""
    launch_each(_code_directions, codes.size, codes.size, [points, dy, dx], [codes])


def search(
    voters: Voters,
    entries: Entries,
    slices: Slices,
    tolerance: int,
    cells: Cells,
    keys: wp.array,
) -> None:
    """Find the 2 x 2 cells with most votes in each tile of each slice."""
    _vote(voters, entries, slices, tolerance, cells, True, keys)


def accumulate(
    voters: Voters,
    entries: Entries,
    slices: Slices,
    tolerance: int,
    cells: Cells,
    votes: wp.array,
) -> None:
    """Count the votes of each cell of each slice."""
    _vote(voters, entries, slices, tolerance, cells, False, votes)


def _vote(
    voters: Voters,
    entries: Entries,
    slices: Slices,
    tolerance: int,
    cells: Cells,
    peaks: bool,
    found: wp.array,
) -> None:
    points, directions = voters.points, entries.directions
    number = slices.turns.shape[0] * slices.scales.shape[0]
    flat = view(found, wp.int32, (math.prod(found.shape),))
    ballot = ballot_of(voters, entries, slices, tolerance, cells)
    rows, columns = (((n - 1) >> cells.shift) + 1 for n in cells[:2])
    if points.device.is_cuda:
        deep, wide, rectangles = cuda.rectangle(rows, columns)
        threads = number * rectangles * cuda.BLOCK
        launch(cuda.searches[peaks], threads, [ballot, deep, wide], [flat])
        return
    size = (rows + 1) * (columns + 1) + cpu.LANES
    count = directions.shape[0]
    pairs = points.shape[1] * count * (2 * tolerance + 1) // (2 * DIRECTIONS)
    parts = slabs(number, number * (pairs + size))
    if parts > 1:  # some directions have more points than others
        parts = min(4 * parts, number)
    windows = scratch("shapes.windows", (parts * count, 4), wp.int32, points.device)
    slab_cells = scratch("shapes.cells", (parts, size), wp.uint16, points.device)
    launch_slabs(cpu.search, number, parts, [ballot, peaks, windows, slab_cells], [flat])
