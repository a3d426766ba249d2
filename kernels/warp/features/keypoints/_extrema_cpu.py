"""Extrema of a scale space on the CPU: a thread takes a slab of rows.

The code (_extrema_cpu.h) is native, because it compares 32 pixels at once, and leaves them at the
first neighbours that exceed all.
"""

from typing import Any

import warp as wp

from cvkern.kernels.codes.features import GRAY, MOST_GRAY
from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

FILE = "_extrema_cpu.h"


def _gray_row(scalar: Any) -> wp.Kernel:
    """Return the kernel for photographs of `scalar`."""

    @_native.each(
        FILE,
        SCALAR=scalar,
        MOST_GRAY=f"{MOST_GRAY}f",
        **{n: f"{w}f" for n, w in zip(("RED", "GREEN", "BLUE"), GRAY, strict=True)},
    )
    def gray_row(
        row: int,
        src: wp.array3d[scalar],  # (H, W, C)
        scale: float,
        # outputs
        dst: wp.array2d[float],  # (H, W)
    ): ...

    return gray_row


gray_rows = {scalar: _gray_row(scalar) for scalar in (wp.float32, wp.uint8)}


@_native.each(FILE)
def halve_row(
    row: int,
    src: wp.array2d[float],
    # outputs
    dst: wp.array2d[float],
): ...


@_native.each(FILE)
def double_row(
    row: int,
    src: wp.array2d[float],  # (H, W)
    # outputs
    dst: wp.array2d[float],  # (2 H, 2 W)
): ...


@_native.each(FILE)
def mark_row(
    row: int,
    levels: wp.array3d[float],  # (L, H, W)
    threshold: float,
    margin: int,
    # outputs
    words: wp.array3d[int],  # (L - 3, H, ceil(W / 32))
    counts: wp.array[int],
): ...


@_native.func_native("_refinement.h")
def keep_one(
    n: int,
    octaves: wp.array2d[wp.int64],
    cells: wp.array2d[int],
    words: wp.array[int],
    counts: wp.array[int],
): ...


@wp.kernel
def keep(
    octaves: wp.array2d[wp.int64],  # (O, 4)
    cells: wp.array2d[int],  # (N, 4)
    # outputs, cleared
    words: wp.array[int],
    counts: wp.array[int],
):
    for n in range(cells.shape[0]):
        keep_one(n, octaves, cells, words, counts)
