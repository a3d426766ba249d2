"""Maxima of an accumulator of lines on the CPU: one thread per slab of rows."""

from typing import Any

import warp as wp

from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False})


def _maxima_of_rows(scalar: Any) -> wp.Kernel:
    """Return the kernel for values of one type."""

    @_native.kernel("_peaks_cpu.h", SCALAR=scalar)
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
    ): ...

    return maxima_of_rows


maxima = {scalar: _maxima_of_rows(scalar) for scalar in (wp.int32, wp.float32)}
