"""Menon's demosaicing on CUDA, in native code: a warp goes down a strip of columns.

All steps are in one kernel, which keeps their rows in registers and exchanges columns by shuffles.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import launch
from cvkern.kernels.warp.raw._types import constants

OPTIONS = {"enable_backward": False, "fuse_fp": False}
BOUNDS = 128, 3  # threads of a block, and blocks of a multiprocessor
LEAST = 40  # rows that a warp writes, at least: even; it begins 16 rows before
HALO = 2  # lanes at either side of a warp that only help, of four columns each
MOST = 2**20  # threads, whose warps take their parts in turns


def demosaic(raw: wp.array, red_row: int, red_column: int, colours: wp.array) -> None:
    """Find the colours of all pixels."""
    height, width = raw.shape
    block, blocks = BOUNDS
    strips = -(-width // (4 * (32 - 2 * HALO)))
    # All warps that run at once, or one wave more would take as long again.
    chunks = max(raw.device.sm_count * blocks * block // 32 // strips, 1)
    rows = max(-(-height // chunks), LEAST)
    rows += rows % 2
    warps = -(-height // rows) * strips
    threads = -(-min(32 * warps, MOST) // block) * block
    launch(kernel(raw.dtype, red_row, red_column), threads, [raw, rows], [colours], block)


@lru_cache
def kernel(scalar: Any, red_row: int, red_column: int) -> wp.Kernel:
    """Make the kernel for values of a type and a place of red."""
    names = {
        "RED_ROW": red_row, "RED_COLUMN": red_column, "HALO": HALO,
        "WARPS": BOUNDS[0] // 32, **constants(scalar),
    }  # fmt: skip

    @_native.kernel("_menon_cuda.cu", OPTIONS, launch_bounds=BOUNDS, **names)
    def interpolate_strips(
        raw: wp.array2d[scalar],
        rows: int,
        # outputs
        colours: wp.array3d[scalar],
    ):
        """Forward to the native code."""

    return interpolate_strips
