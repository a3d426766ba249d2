"""Votes for lines, in Warp.

A point (y, x) votes at angle t for the bin of rho = x cos t + y sin t; _votes_cpu.py has the
source. On the CPU each slab of angles has its own histograms; on CUDA a block has one in shared
memory.
"""

from collections.abc import Iterator

import numpy as np
import warp as wp

from cvkern.kernels.codes.hough import DIRECTIONS, LineTables, LineWindows
from cvkern.kernels.warp._launch import cpu_threads, launch, launch_slabs, scratch, view
from cvkern.kernels.warp.hough._directions import direction_code

from . import _votes_cpu as cpu
from . import _votes_cuda as cuda

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

HALF_TURN = wp.constant(DIRECTIONS // 2 - 1)
_THREADS = 1 << 16  # most CUDA threads, if the host does not know the number of points
_SHARES = 360  # number of blocks; fewer leave an H200 idle, more take longer to add


@wp.kernel
def _take(
    points: wp.array2d[int],  # (capacity, 2)
    starts: wp.array[int],
    values: wp.array2d[float],  # (H, W)
    threads: int,
    # outputs
    taken: wp.array[float],  # (capacity,)
):
    i = wp.tid()
    while i < starts[starts.shape[0] - 1]:
        taken[i] = values[points[i, 0], points[i, 1]]
        i += threads


@wp.kernel
def _find_windows(
    starts: wp.array[int],
    orientation: wp.array[float],  # (capacity,)
    first: wp.array[int],  # (DIRECTIONS / 2,)
    number: wp.array[int],
    threads: int,
    # outputs
    windows: wp.array2d[int],  # (capacity, 2): first angle, number of angles
):
    i = wp.tid()
    while i < starts[starts.shape[0] - 1]:
        code = direction_code(orientation[i]) & HALF_TURN
        windows[i, 0] = first[code]
        windows[i, 1] = number[code]
        i += threads


def take(points: wp.array, starts: wp.array, values: wp.array, taken: wp.array) -> None:
    """Look up the value at every point; one thread on the CPU, a strided loop on CUDA."""
    threads = _threads(points)
    launch(_take, threads, [points, starts, values, threads], [taken])


def vote(
    points: wp.array,
    starts: wp.array,
    tables: LineTables,
    weights: wp.array | None,
    votes: wp.array,
) -> None:
    """Count the votes of all points at all angles, by 1 or their weight; fill `votes`.

    `votes` are (R, T), or (N, R, T) of a stack. Then the points are those of all images, one image
    after the other, and their rows are numbered on from image to image.
    """
    images, bins, angles = (1, *votes.shape)[-3:]
    weighted = weights is not None
    given = weights if weighted else starts  # without weights, any array of the same type
    if votes.device.is_cuda:
        size = cuda.SMALL if bins <= cuda.SMALL else cuda.LARGE
        parts = -(-bins // size)
        count = max(1, min(8, _SHARES // (images * angles * parts)))
        shares = scratch("lines.shares", (images * count, angles, bins), wp.int32, votes.device)
        launch(
            cuda.votes[size, weighted],
            images * count * parts * angles * cuda.BLOCK,
            [points, starts, *tables, parts, given, images],
            [shares],
        )
        squares = -(-bins // cuda.TILE) * -(-angles // cuda.TILE)
        launch(cuda.add_up, images * squares * cuda.BLOCK, [shares], [_planes(votes)])
        return
    groups = -(-angles // cpu.ANGLES)
    count = min(4 * cpu_threads(), groups)
    lines = scratch("lines.lines", (count * cpu.GROUP, bins), wp.int32, votes.device)
    for of_image, moved, filled in _images(starts, tables, votes):
        inputs = [points, of_image, *moved, given, lines]
        launch_slabs(cpu.votes[weighted], groups, count, inputs, [filled])


def vote_directed(
    points: wp.array,
    starts: wp.array,
    windows: LineWindows,
    tables: LineTables,
    weights: wp.array | None,
    votes: wp.array,
) -> None:
    """Count the votes of all points at the angles of their direction; fill `votes`."""
    threads = _threads(points)
    found = scratch("lines.windows", tuple(points.shape), wp.int32, votes.device)
    launch(_find_windows, threads, [starts, *windows, threads], [found])
    weighted = weights is not None
    given = weights if weighted else starts
    if votes.device.is_cuda:
        inputs = [points, starts, found, *tables, weighted, given, threads]
        launch(cuda.clear, votes.size, [], [view(votes, wp.int32, (votes.size,))])
        launch(cuda.vote_directed, threads, inputs, [_planes(votes)])
        return
    angles = votes.shape[-1]
    count = min(2 * cpu_threads(), angles)
    for of_image, moved, filled in _images(starts, tables, votes):
        inputs = [points, of_image, found, *moved, given]
        launch_slabs(cpu.directed_votes[weighted], angles, count, inputs, [filled])


def _planes(votes: wp.array) -> wp.array:
    return view(votes, wp.int32, (1, *votes.shape)[-3:])


def _images(
    starts: wp.array, tables: LineTables, votes: wp.array
) -> Iterator[tuple[wp.array, LineTables, wp.array]]:
    """Yield the starts of the rows of each image, tables for its points, and its votes.

    The rows of the points are numbered on from image to image; the offsets subtract that.
    """
    if votes.ndim == 2:
        yield starts, tables, votes
        return
    height = (starts.shape[0] - 1) // votes.shape[0]
    offset, sine = tables.offset.numpy(), tables.sine.numpy().astype(np.int64)
    for n in range(votes.shape[0]):
        moved = wp.array(offset - n * height * sine, dtype=wp.int64, device=votes.device)
        rows = starts[n * height : (n + 1) * height + 1]
        yield rows, tables._replace(offset=moved), votes[n]


def _threads(points: wp.array) -> int:
    return min(_THREADS, points.shape[0]) if points.device.is_cuda else 1
