"""Maxima of an accumulator of lines, in Warp: one thread per slab of rows, or per element on CUDA.

A maximum is above a threshold. In a window around it, no value is larger, and no equal value
precedes it. The window may continue past the last angle, at the first: after half a turn, rho
changes its sign.
"""

from typing import Any

import warp as wp

from cvkern.kernels.warp._launch import launch, launch_each, launch_slabs, slabs

from . import _peaks_cpu as cpu

wp.set_module_options({"enable_backward": False})


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
