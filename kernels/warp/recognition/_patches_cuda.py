"""Normalised patches on CUDA: a warp a patch."""

import warp as wp

from cvkern.kernels.codes.recognition import LARGEST, SPREAD, WHITE
from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

LANES = 32  # threads of a patch


@_native.kernel("_patches_cuda.cu", SPREAD=SPREAD, LARGEST=LARGEST, WHITE=WHITE)
def sample(
    image: wp.array[float],  # (P,)
    corners: wp.array2d[int],  # (N, 2)
    side: int,
    least: wp.int64,
    # outputs
    patches: wp.array2d[wp.int8],  # (N, D)
): ...
