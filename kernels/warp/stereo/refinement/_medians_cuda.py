"""Weighted medians on CUDA: one thread per pixel, with its whole window in registers.

medians.py has the rule. The code is native, because registers need unrolled loops over windows of
up to 31 pixels.
"""

from functools import lru_cache

import warp as wp

from cvkern.kernels.warp import _native

_OPTIONS = {"enable_backward": False, "fuse_fp": False}


@lru_cache
def medians(radius: int) -> list[wp.Kernel]:
    """Return the kernels of one radius: along the rows, and down the columns."""
    return [_median(radius, down) for down in (0, 1)]


def _median(radius: int, down: int) -> wp.Kernel:
    @_native.kernel("_medians_cuda.cu", _OPTIONS, RADIUS=radius, DOWN=down)
    def median(
        disparity: wp.array2d[float],  # (H, W)
        guide: wp.array2d[wp.uint8],  # (H, W)
        contrast: int,
        # outputs
        smooth: wp.array2d[float],  # (H, W)
    ): ...

    return median
