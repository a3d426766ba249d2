"""Figures of objects on CUDA: a warp adds up the masks of a patch."""

import warp as wp

from cvkern.kernels.codes.recognition import FINE, KERNEL_ONE, LARGEST_PATCH, OCTAVE
from cvkern.kernels.warp import _native

from ._space import Ballot, Painter

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

PARTS = 8  # warps of a row of patches and a mode


@_native.kernel(
    "_figures_cuda.cu",
    PARTS=PARTS, LARGEST=LARGEST_PATCH, ONE=KERNEL_ONE, APART=OCTAVE // 2, FINE=FINE,
)  # fmt: skip
def paint(
    ballot: Ballot,
    by: Painter,
    figures: wp.array2d[wp.uint8],  # (O, S S)
    modes: wp.array2d[int],  # (R + 1, 4)
    # outputs
    balance: wp.array3d[int],  # (T, H, W)
): ...
