"""Votes for lines, in Warp.

On the CPU a slab of angles has histograms of its own; on CUDA a block has one in shared memory.
"""

import warp as wp

from cvkern.kernels.warp._launch import cpu_threads, launch, launch_slabs, scratch

from . import _lookups as line_points
from . import _votes_cpu as cpu
from . import _votes_cuda as cuda

_SHARES = (
    360  # blocks at work in all, or a little less: fewer leave an H200 idle, more add up longer
)


def take(points: wp.array, starts: wp.array, values: wp.array, taken: wp.array) -> None:
    """Look the value of every point up; one thread in all, or each with every so many points."""
    threads = _threads(points)
    launch(line_points.take, threads, [points, starts, values, threads], [taken])


def vote(
    points: wp.array,
    starts: wp.array,
    cosine: wp.array,
    sine: wp.array,
    offset: wp.array,
    shift: int,
    weighted: bool,
    weights: wp.array,
    votes: wp.array,
) -> None:
    """Let every point vote at all angles; `votes` is overwritten."""
    bins, angles = votes.shape
    tables = [cosine, sine, offset, shift]
    if votes.device.is_cuda:
        size = cuda.SMALL if bins <= cuda.SMALL else cuda.LARGE
        parts = -(-bins // size)
        count = max(1, min(8, _SHARES // (angles * parts)))
        shares = scratch("lines.shares", (count, angles, bins), wp.int32, votes.device)
        launch(
            cuda.votes[size, weighted],
            count * parts * angles * cuda.BLOCK,
            [points, starts, *tables, parts, weights],
            [shares],
        )
        squares = -(-bins // cuda.TILE) * -(-angles // cuda.TILE)
        launch(cuda.add_up, squares * cuda.BLOCK, [shares], [votes])
        return
    groups = -(-angles // cpu.ANGLES)
    count = min(4 * cpu_threads(), groups)
    lines = scratch("lines.lines", (count * cpu.GROUP, bins), wp.int32, votes.device)
    launch_slabs(
        cpu.vote, groups, count, [points, starts, *tables, weighted, weights, lines], [votes]
    )


def vote_directed(
    points: wp.array,
    starts: wp.array,
    orientation: wp.array,
    first: wp.array,
    number: wp.array,
    cosine: wp.array,
    sine: wp.array,
    offset: wp.array,
    shift: int,
    weighted: bool,
    weights: wp.array,
    votes: wp.array,
) -> None:
    """Let every point vote at the angles of its direction code; `votes` is overwritten."""
    threads = _threads(points)
    windows = scratch("lines.windows", tuple(points.shape), wp.int32, votes.device)
    launch(
        line_points.find_windows, threads, [starts, orientation, first, number, threads], [windows]
    )
    inputs = [points, starts, windows, cosine, sine, offset, shift, weighted, weights]
    if votes.device.is_cuda:
        launch(cuda.clear, votes.size, [], [votes])
        launch(cuda.vote_directed, threads, [*inputs, threads], [votes])
        return
    angles = votes.shape[1]
    launch_slabs(cpu.vote_directed, angles, min(2 * cpu_threads(), angles), inputs, [votes])


def _threads(points: wp.array) -> int:
    return min(line_points.THREADS, points.shape[0]) if points.device.is_cuda else 1
