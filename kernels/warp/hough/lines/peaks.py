"""Maxima of an accumulator of lines, in Warp: one thread per slab of rows, or per element on CUDA.

A maximum is above a threshold. In a window around it, no value is larger, and no equal value
precedes it. The window may continue past the last angle, at the first: after half a turn, rho
changes its sign.
"""

from typing import Any

import warp as wp

from cvkern.kernels.codes.hough import LineTables, LineWindows, most_peaks
from cvkern.kernels.warp._launch import launch, launch_each, launch_slabs, scratch, slabs
from cvkern.kernels.warp.hough import points as masks

from . import _bands_cpu as bands
from . import _peaks_cpu as cpu
from . import votes as accumulators

wp.set_module_options({"enable_backward": False})

MOST_VOTES = wp.constant(2**31 - 1)
_THREADS = 1 << 16  # most CUDA threads, as the host does not know the number of peaks


def _maxima(scalar: Any) -> wp.Kernel:
    """Return the kernel for values of one type on CUDA."""

    @wp.func
    def is_maximum(
        values: wp.array2d[scalar],
        bin: int,
        angle: int,
        min_distance: int,
        min_angle: int,
        wraps: bool,
    ) -> bool:
        """Tell whether no value in the window is larger, and no equal value precedes."""
        bins = values.shape[0]
        angles = values.shape[1]
        here = values[bin, angle]
        for dt in range(-min_angle, min_angle + 1):
            t = angle + dt
            middle = bin
            if wraps and (t < 0 or t >= angles):
                t = wp.where(t < 0, t + angles, t - angles)
                middle = bins - 1 - bin
            if t >= 0 and t < angles:
                low = wp.max(middle - min_distance, 0)
                for r in range(low, wp.min(middle + min_distance + 1, bins)):
                    there = values[r, t]
                    if there > here:
                        return False
                    if there == here and r * angles + t < bin * angles + angle:
                        return False
        return True

    @wp.kernel
    def maxima(
        values: wp.array2d[scalar],  # (R, T)
        threshold: scalar,
        min_distance: int,
        min_angle: int,
        wraps: bool,
        # outputs
        mask: wp.array2d[wp.uint8],  # (R, T)
    ):
        i = wp.tid()
        bin = i // values.shape[1]
        angle = i - bin * values.shape[1]
        found = values[bin, angle] > threshold
        if found:
            found = is_maximum(values, bin, angle, min_distance, min_angle, wraps)
        mask[bin, angle] = wp.where(found, wp.uint8(1), wp.uint8(0))

    return maxima


@wp.kernel
def _take(
    stride: int,
    first: int,
    last: int,
    values: wp.array2d[Any],  # (R, T)
    bins: wp.array2d[int],  # (K, 2)
    # outputs
    taken: wp.array[wp.float64],  # (K,)
):
    for i in range(first + wp.tid(), last, stride):
        taken[i] = wp.float64(values[bins[i, 0], bins[i, 1]])


@wp.kernel
def _list_keys(
    values: wp.array2d[int],  # (R, T)
    starts: wp.array[int],  # its last element is the number of peaks
    bins: wp.array2d[int],  # (capacity, 2)
    threads: int,
    # outputs
    keys: wp.array[wp.int64],  # (capacity,)
    total: wp.array[int],  # (1,)
):
    i = wp.tid()
    number = starts[starts.shape[0] - 1]
    if i == 0:
        total[0] = number
    while i < number:
        place = wp.int64(bins[i, 0]) * wp.int64(values.shape[1]) + wp.int64(bins[i, 1])
        less = wp.int64(MOST_VOTES - values[bins[i, 0], bins[i, 1]])
        keys[i] = (less << wp.int64(32)) + place
        i += threads


_takes = {
    scalar: wp.overload(_take, {"values": wp.array2d[scalar]}) for scalar in (wp.int32, wp.float32)
}
_maxima_of = {scalar: _maxima(scalar) for scalar in (wp.int32, wp.float32)}


def local_maxima(
    values: wp.array,
    threshold: float,
    min_distance: int,
    min_angle: int,
    wraps: bool,
    mask: wp.array,
) -> None:
    """Mark values above the threshold that are the first largest in their window."""
    limit = int(threshold) if values.dtype is wp.int32 else float(threshold)
    inputs = [values, limit, min_distance, min_angle, wraps]
    if values.device.is_cuda:
        launch(_maxima_of[values.dtype], values.size, inputs, [mask])
        return
    count = slabs(values.shape[0], values.size)
    count = min(4 * count, values.shape[0]) if count > 1 else 1  # maxima gather in few rows
    launch_slabs(cpu.maxima[values.dtype], values.shape[0], count, inputs, [mask])


def take(values: wp.array, bins: wp.array, taken: wp.array) -> None:
    """Look up the values of bins (K, 2)."""
    number = taken.shape[0]
    launch_each(_takes[values.dtype], number, number, [values, bins], [taken])


def find_lines(
    points: wp.array,
    starts: wp.array,
    windows: LineWindows,
    tables: LineTables,
    shape: tuple[int, int],
    threshold: int,
    apart: tuple[int, int],
    keys: wp.array,
    total: wp.array,
) -> None:
    """List the lines with more votes than the threshold that are the first largest near them.

    Votes are those of `vote_directed` in (R, T) bins; the angles cover half a turn, and each
    direction has one or more. Near are at most `apart` bins of rho and theta, 1 or more, as in
    `local_maxima`. A key is 2^31 - 1 less the votes, shifted by 32, plus the number of the bin, row
    by row.
    """
    device, (bins, angles) = points.device, shape
    if device.is_cuda:
        votes = scratch("peaks.votes", shape, wp.int32, device)
        mask = scratch("peaks.mask", shape, wp.uint8, device)
        counts = scratch("peaks.starts", (bins + 1,), wp.int32, device)
        places = scratch("peaks.bins", (keys.shape[0], 2), wp.int32, device)
        accumulators.vote_directed(points, starts, windows, tables, None, votes)
        local_maxima(votes, threshold, *apart, True, mask)
        masks.count(mask, counts)
        masks.gather(mask, counts, places)
        threads = min(_THREADS, keys.shape[0])
        launch(_list_keys, threads, [votes, counts, places, threads], [keys, total])
        return
    number, count = points.shape[0], slabs(angles, shape[0] * angles // 16)  # 16 bins at a time
    count = min(2 * count, angles) if count > 1 else 1  # some angles have more votes
    turned = scratch("peaks.turned", (number,), wp.int32, device)
    voters = bands.Voters()
    voters.points = scratch("peaks.voters", (number, 2), wp.int32, device)
    voters.begins = scratch("peaks.begins", (bands.CODES + 2,), wp.int32, device)
    voters.codes = scratch("peaks.codes", (angles, 2), wp.int32, device)
    voters.cosine, voters.sine, voters.offset, shift = tables
    given = [points, starts, windows.orientation, turned]
    launch(bands.sort_by_direction, 1, given, [voters.begins, voters.points])
    launch(bands.find_codes, 1, [windows.first, windows.number], [voters.codes])
    width = -(-bins // bands.LANES) * bands.LANES + 2 * apart[0]
    lines = scratch("peaks.lines", (count * (2 * apart[1] + 1), width), wp.int32, device)
    room = most_peaks((bins, -(-angles // count)), apart)
    found = scratch("peaks.found", (count, room), wp.int64, device)
    counts = scratch("peaks.counts", (count,), wp.int32, device)
    limits = wp.vec4i(bins, threshold, *apart)
    launch_slabs(bands.find_peaks, angles, count, [voters, shift, limits, lines], [found, counts])
    launch(bands.collect, 1, [found, counts], [keys, total])
