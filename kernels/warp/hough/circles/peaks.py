"""Peaks among the votes for circles, in Warp."""

from typing import Any

import warp as wp

from cvkern.kernels.warp._launch import launch, launch_slabs, slabs

from . import _peaks as peaks


def row_maxima(votes: wp.array, tops: wp.array) -> None:
    """Find the largest of each row of each plane."""
    _by_rows(peaks.row_maxima, peaks.row_maximum, votes, [], [tops])


def count_peaks(votes: wp.array, limits: wp.array, down: int, along: int, counts: wp.array) -> None:
    """Count the peaks of each row: above the limit of their plane, and largest around."""
    _by_rows(peaks.count_peaks, peaks.count_row, votes, [limits, down, along], [counts])


def gather_peaks(
    votes: wp.array,
    limits: wp.array,
    down: int,
    along: int,
    starts: wp.array,
    places: wp.array,
    values: wp.array,
) -> None:
    """List plane, row, column and votes of the peaks of each row, from its place in `starts` on."""
    inputs = [limits, down, along, starts]
    _by_rows(peaks.gather_peaks, peaks.gather_row, votes, inputs, [places, values])


def _by_rows(
    slab: wp.Kernel, row: wp.Kernel, votes: wp.array, inputs: list[Any], outputs: list[wp.array]
) -> None:
    rows = votes.shape[0] * votes.shape[1]
    if votes.device.is_cuda:
        launch(row, rows, [votes, *inputs], outputs)
        return
    launch_slabs(slab, rows, slabs(rows, votes.size), [votes, *inputs], outputs)
