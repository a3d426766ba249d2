"""Peaks among the votes for circles, in Warp: a thread takes rows (CPU), a block a row (CUDA).

A peak is above the limit of its plane. In a window around it, no value is larger, and no equal
value precedes it. Each row counts its peaks, the host computes the prefix sum of the counts, and
then each row lists its peaks at its place.
"""

from typing import Any

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp._lanes_cpu import WIDE, f32_wide, vectors
from cvkern.kernels.warp._launch import BLOCK, launch, launch_each, launch_slabs, slabs, view

from . import _peaks_cuda as cuda

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@_native.func_native("_peaks_of_rows.h")
def count_in_row(
    votes: wp.array3d[float],
    row: int,
    limits: wp.array[float],
    down: int,
    along: int,
    counts: wp.array[int],
):
    """Count the peaks of a row."""


@_native.func_native("_peaks_of_rows.h")
def gather_in_row(
    votes: wp.array3d[float],
    row: int,
    limits: wp.array[float],
    down: int,
    along: int,
    starts: wp.array[int],
    places: wp.array2d[int],
    values: wp.array[float],
):
    """List the peaks of a row, beginning at its place in `starts`."""


@wp.kernel
def _row_maxima(
    stride: int,
    first: int,
    last: int,
    votes: wp.array2d[float],  # (P H, W)
    # outputs
    tops: wp.array[float],  # (P H,)
):
    for row in range(first + wp.tid(), last, stride):
        top = votes[row, 0]
        for x in range(1, votes.shape[1]):
            top = wp.max(top, votes[row, x])
        tops[row] = top


@wp.kernel
def _row_maxima_of_lanes(
    slab: int,
    first: int,
    last: int,
    lanes: wp.array2d[f32_wide],  # (P H, W)
    # outputs
    tops: wp.array[float],  # (P H,)
):
    behind = lanes.shape[1] - 1  # begin of the last vector of a row
    for row in range(first, last):
        top = lanes[row, 0]
        for x in range(WIDE, behind + WIDE, WIDE):
            top = wp.max(top, lanes[row, wp.min(x, behind)])
        tops[row] = wp.max(top)


@wp.kernel
def _count_peaks(
    stride: int,
    first: int,
    last: int,
    votes: wp.array3d[float],  # (P, H, W)
    limits: wp.array[float],  # (P,)
    down: int,
    along: int,
    # outputs
    counts: wp.array[int],  # (P H,)
):
    for row in range(first + wp.tid(), last, stride):
        count_in_row(votes, row, limits, down, along, counts)


@wp.kernel
def _gather_peaks(
    stride: int,
    first: int,
    last: int,
    votes: wp.array3d[float],  # (P, H, W)
    limits: wp.array[float],  # (P,)
    down: int,
    along: int,
    starts: wp.array[int],  # (P H + 1,)
    # outputs
    places: wp.array2d[int],  # (N, 3)
    values: wp.array[float],  # (N,)
):
    for row in range(first + wp.tid(), last, stride):
        gather_in_row(votes, row, limits, down, along, starts, places, values)


def row_maxima(votes: wp.array, tops: wp.array) -> None:
    """Find the largest value of each row of each plane."""
    rows, width = votes.shape[0] * votes.shape[1], votes.shape[2]
    flat = view(votes, wp.float32, (rows, width))
    if votes.device.is_cuda or width < WIDE:
        launch_each(_row_maxima, rows, votes.size, [flat], [tops])
        return
    lanes = vectors(flat, f32_wide)
    launch_slabs(_row_maxima_of_lanes, rows, slabs(rows, votes.size), [lanes], [tops])


def count_peaks(votes: wp.array, limits: wp.array, down: int, along: int, counts: wp.array) -> None:
    """Count the peaks of each row."""
    _by_rows(_count_peaks, cuda.count_peaks, votes, [limits, down, along], [counts])


def gather_peaks(
    votes: wp.array,
    limits: wp.array,
    down: int,
    along: int,
    starts: wp.array,
    places: wp.array,
    values: wp.array,
) -> None:
    """List plane, row, column and votes of the peaks of each row, at its place in `starts`."""
    inputs, outputs = [limits, down, along, starts], [places, values]
    _by_rows(_gather_peaks, cuda.gather_peaks, votes, inputs, outputs)


def _by_rows(
    kernel: wp.Kernel,
    on_cuda: wp.Kernel,
    votes: wp.array,
    inputs: list[Any],
    outputs: list[wp.array],
) -> None:
    rows = votes.shape[0] * votes.shape[1]
    if votes.device.is_cuda:
        launch(on_cuda, rows * BLOCK, [votes, *inputs], outputs)
        return
    launch_each(kernel, rows, votes.size, [votes, *inputs], outputs)
