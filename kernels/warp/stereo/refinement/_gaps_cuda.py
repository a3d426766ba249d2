"""Gaps on CUDA: a warp takes a row, and finds the disparities around a gap by ballots.

gaps.py has the rule. The code is native for these ballots and shuffles.
"""

import warp as wp

from cvkern.kernels.warp import _native

BLOCK = 64  # threads of a block: two rows
_OPTIONS = {"enable_backward": False, "fuse_fp": False}


@_native.kernel("_gaps_cuda.cu", _OPTIONS)
def fill_rows(
    disparity: wp.array2d[float],  # (H, W)
    # outputs
    filled: wp.array2d[float],  # (H, W)
    valid: wp.array2d[wp.uint8],  # (H, W)
    found: wp.array[int],  # (H,) whether a row has any
): ...


@_native.kernel("_gaps_cuda.cu", _OPTIONS)
def fill_empty_rows(
    found: wp.array[int],  # (H,) whether a row has any
    # outputs
    filled: wp.array2d[float],  # (H, W)
): ...
