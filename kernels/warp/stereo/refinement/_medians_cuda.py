"""Weighted medians on CUDA: one thread for two neighbouring pixels.

medians.py has the rule. Plain Warp took 90 us for 1080p and radius 6 on an H200. Two windows share
their comparisons, and their sums of weights are the halves of a number.
"""

from functools import lru_cache

import warp as wp

from cvkern.kernels.warp import _native

_OPTIONS = {"enable_backward": False, "fuse_fp": False}


def medians(radius: int, contrast: int) -> list[wp.Kernel]:
    """Return the kernels of one radius: along the rows, and down the columns."""
    narrow = (2 * radius + 1) * contrast < 1 << 16
    return [_median(radius, down, narrow) for down in (0, 1)]


@lru_cache
def _median(radius: int, down: int, narrow: bool) -> wp.Kernel:
    number, bits = ("unsigned", 16) if narrow else ("unsigned long long", 32)

    @_native.kernel(
        "_medians_cuda.cu", _OPTIONS, RADIUS=radius, DOWN=down, NUMBER=number, BITS=bits
    )
    def median(
        disparity: wp.array2d[float],  # (H, W)
        guide: wp.array2d[wp.uint8],  # (H, W)
        contrast: int,
        # outputs
        smooth: wp.array2d[float],  # (H, W)
    ): ...

    return median
