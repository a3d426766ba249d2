"""The census transform on the CPU: one thread per slab of rows, 64 pixels at once.

census.py describes the transform. The code is native, because a comparison of 64 bytes takes only a
few instructions.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.warp import _native

from ._windows_cpu import OPTIONS


@lru_cache
def census(scalar: Any) -> wp.Kernel:
    """Return the kernel for values of one type."""

    @_native.kernel("_census_cpu.h", OPTIONS, TYPE=scalar)
    def census(
        slab: int,
        first: int,
        last: int,
        image: wp.array3d[scalar],  # (H, W, C)
        radius_y: int,
        radius_x: int,
        spacing: int,
        symmetric: int,
        # scratch
        lines: wp.array2d[scalar],  # (slabs (2 reach + 1), (W + 2 radius_x spacing) C + 64)
        # outputs
        bits: wp.array3d[wp.uint64],  # (H, W, C)
    ): ...

    return census
