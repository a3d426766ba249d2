"""Structures of winners for the kernels of both devices: their arrays, and the rule's parameters.

The rule itself is in _winner.h, in C++ for both devices.
"""

import warp as wp

from cvkern.kernels.codes.stereo import Subpixel

# Without fused multiply-add a disparity has the same bits on every device.
OPTIONS = {"enable_backward": False, "fuse_fp": False}
# Constants of _winner.h.
CURVES = {"NO_SUBPIXEL": int(Subpixel.NONE), "PARABOLA": int(Subpixel.PARABOLA)}


@wp.struct
class WinnerArrays:
    """`Winners` for kernels."""

    index: wp.array2d[int]
    disparity: wp.array2d[float]
    cost: wp.array2d[float]
    confidence: wp.array2d[float]


@wp.struct
class WinnerRule:
    """`Rule` for kernels."""

    first: int
    subpixel: int
    uniqueness: int
