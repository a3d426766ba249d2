"""Zero-mean normalised cross-correlation on the CPU, from sums of products (_sums_cpu.h).

correlation.py has the equation. One thread per slab of rows. The code is native for the same reason
as the sums: it computes 16 or 32 disparities at once.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.stereo import Cost
from cvkern.kernels.warp import _native

from ._moments import Moments
from ._windows_cpu import OPTIONS, Windows, constants


def products_dtype(pixel: Any) -> Any:
    """Return the type that holds sums of products of two pixels."""
    return wp.float64 if pixel is wp.float32 else wp.int32


@lru_cache
def correlation(pixel: Any) -> wp.Kernel:
    """Return the kernel of the costs, for images of this type."""
    products = products_dtype(pixel)

    @_native.kernel("_correlation_cpu.h", OPTIONS, **constants(Cost.ZNCC, pixel, products))
    def correlation(
        slab: int,
        first: int,
        last: int,
        left: wp.array3d[pixel],  # (H, W, C)
        right: wp.array3d[pixel],  # (H, W, C)
        windows: Windows,
        of_left: Moments,
        of_right: Moments,
        # scratch, (slabs, ...)
        lines: wp.array2d[pixel],  # 2 rows of lines
        columns: wp.array2d[products],  # (W + 2 radius_x) padded(D)
        moments: wp.array2d[wp.float64],  # (1 + C) (W + padded(D))
        # outputs
        costs: wp.array3d[float],  # (H, W, D)
    ): ...

    return correlation
