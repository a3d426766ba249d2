"""Robust fits on CUDA: a warp takes a group of hypotheses, a model, or a pair of images.

The code (_robust_cuda.cu) is native for the shuffles that add up a warp's sums in a fixed order,
and because it shares _robust.h with the CPU.
"""

import warp as wp

from cvkern.kernels.codes.geometry import (
    COST_ONE,
    FLAT,
    GROUP,
    NO_COST,
    PREVIEW,
    SUMS,
)
from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BLOCK = 128  # four warps
_FILE = "_robust_cuda.cu"
_OPTIONS = {"enable_backward": False, "fuse_fp": False}


def threads(items: int) -> int:
    """Return the threads of a launch with a warp an item, in whole blocks."""
    return -(-items * 32 // BLOCK) * BLOCK


@_native.kernel(
    _FILE, _OPTIONS, GROUP=GROUP, PREVIEW=PREVIEW, COST_ONE=COST_ONE, NO_COST=NO_COST, FLAT=FLAT
)
def propose(
    matches: wp.array2d[float],
    spans: wp.array2d[int],
    squares: wp.array[float],
    known: wp.array2d[wp.float64],
    pairs: wp.array[int],
    draw: wp.vec3i,
    models: wp.array3d[float],
    costs: wp.array2d[int],
): ...


@_native.kernel(_FILE, _OPTIONS, SUMS=max(SUMS), COST_ONE=COST_ONE)
def refine(
    matches: wp.array2d[float],
    spans: wp.array2d[int],
    squares: wp.array[float],
    known: wp.array2d[wp.float64],
    pairs: wp.array[int],
    kind: int,
    schedule: wp.array[float],
    models: wp.array3d[wp.float64],
    scores: wp.array3d[int],
): ...


@_native.kernel(_FILE, _OPTIONS)
def mark(
    matches: wp.array2d[float],
    spans: wp.array2d[int],
    squares: wp.array[float],
    known: wp.array2d[wp.float64],
    kind: int,
    models: wp.array2d[wp.float64],
    inliers: wp.array[wp.uint8],
): ...
