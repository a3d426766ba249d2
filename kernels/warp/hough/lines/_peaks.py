"""Maxima of an accumulator of lines, on the CPU and on CUDA."""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})


def _maxima(scalar: Any) -> tuple[wp.Kernel, wp.Kernel]:
    """Return the kernels, for the CPU and for CUDA, for values of one type."""

    @wp.func
    def is_maximum(
        values: wp.array2d[scalar],
        bin: int,
        angle: int,
        min_distance: int,
        min_angle: int,
        wraps: bool,
    ) -> bool:
        """Tell whether nothing in the window is larger, or equal and before it.

        Half a turn on, rho changes its sign.
        """
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
    def maxima_of_rows(
        slab: int,
        first: int,
        last: int,
        values: wp.array2d[scalar],  # (R, T)
        threshold: scalar,
        min_distance: int,
        min_angle: int,
        wraps: bool,
        # outputs
        mask: wp.array2d[wp.uint8],  # (R, T)
    ):
        for bin in range(first, last):
            for angle in range(values.shape[1]):
                found = values[bin, angle] > threshold
                if found:
                    found = is_maximum(values, bin, angle, min_distance, min_angle, wraps)
                mask[bin, angle] = wp.where(found, wp.uint8(1), wp.uint8(0))

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

    return maxima_of_rows, maxima


maxima = {scalar: _maxima(scalar) for scalar in (wp.int32, wp.float32)}
