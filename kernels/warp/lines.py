"""Votes for lines, and the maxima among them, in Warp.

On the CPU a slab of angles has histograms of its own; on CUDA a block has one in shared memory.
"""

import warp as wp

from . import _lines_blocks as blocks
from . import _lines_peaks as peaks
from . import _lines_points as line_points
from . import _lines_rows as rows
from ._launch import cpu_threads, launch, launch_slabs, scratch, slabs

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
        size = blocks.SMALL if bins <= blocks.SMALL else blocks.LARGE
        parts = -(-bins // size)
        count = max(1, min(8, _SHARES // (angles * parts)))
        shares = scratch("lines.shares", (count, angles, bins), wp.int32, votes.device)
        launch(
            blocks.votes[size, weighted],
            count * parts * angles * blocks.BLOCK,
            [points, starts, *tables, parts, weights],
            [shares],
        )
        squares = -(-bins // blocks.TILE) * -(-angles // blocks.TILE)
        launch(blocks.add_up, squares * blocks.BLOCK, [shares], [votes])
        return
    groups = -(-angles // rows.ANGLES)
    count = min(4 * cpu_threads(), groups)
    lines = scratch("lines.lines", (count * rows.GROUP, bins), wp.int32, votes.device)
    launch_slabs(
        rows.vote, groups, count, [points, starts, *tables, weighted, weights, lines], [votes]
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
        launch(blocks.clear, votes.size, [], [votes])
        launch(blocks.vote_directed, threads, [*inputs, threads], [votes])
        return
    angles = votes.shape[1]
    launch_slabs(rows.vote_directed, angles, min(2 * cpu_threads(), angles), inputs, [votes])


def _threads(points: wp.array) -> int:
    return min(line_points.THREADS, points.shape[0]) if points.device.is_cuda else 1


def local_maxima(
    values: wp.array,
    threshold: float,
    min_distance: int,
    min_angle: int,
    wraps: bool,
    mask: wp.array,
) -> None:
    """Mark what is above the threshold and the first largest in its window.

    One thread a slab of rows, or one an element.
    """
    of_rows, of_elements = peaks.maxima[values.dtype]
    limit = int(threshold) if values.dtype is wp.int32 else float(threshold)
    inputs = [values, limit, min_distance, min_angle, wraps]
    if values.device.is_cuda:
        launch(of_elements, values.size, inputs, [mask])
        return
    count = slabs(values.shape[0], values.size)
    count = min(4 * count, values.shape[0]) if count > 1 else 1  # maxima gather in few rows
    launch_slabs(of_rows, values.shape[0], count, inputs, [mask])
