"""Weighted medians on CUDA: one thread for two neighbouring pixels.

medians.py has the rule. Plain Warp took 90 us for 1080p and radius 6 on an H200. Two windows share
their comparisons, and sums of weights are floats, which other units of the processor add.
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
