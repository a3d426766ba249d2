"""Figures of objects on the CPU: the masks of a patch are added up first, 16 pixels at once."""

import warp as wp

from cvkern.kernels.codes.recognition import FINE, KERNEL_ONE, LARGEST_PATCH, OCTAVE
from cvkern.kernels.warp import _native

from ._space import Ballot, Painter

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@_native.func_native(
    "_figures_cpu.h", LANES=16, LARGEST=LARGEST_PATCH, ONE=KERNEL_ONE, APART=OCTAVE // 2, FINE=FINE
)
def paint_mode(
    t: int,
    ballot: Ballot,
    by: Painter,
    figures: wp.array2d[wp.uint8],
    modes: wp.array2d[int],
    balance: wp.array3d[int],
): ...


@wp.kernel
def paint(
    slab: int,
    first: int,
    last: int,
    ballot: Ballot,
    by: Painter,
    figures: wp.array2d[wp.uint8],  # (O, S S)
    modes: wp.array2d[int],  # (T, 4)
    # outputs
    balance: wp.array3d[int],  # (T, H, W)
):
    for t in range(first, last):
        paint_mode(t, ballot, by, figures, modes, balance)
