"""A bilateral grid on CUDA, in native code: a block fills the cells of one place."""

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp.raw._tone_cuda import OPTIONS, SUMS

DEEPEST = 512  # cells along Z: light extends over 253 stops, and cells over more than one
NAMES = {**SUMS, "DEEPEST": DEEPEST}


@_native.kernel("_grids_cuda.cu", OPTIONS, **NAMES)
def fill_cells(
    logs: wp.array2d[float],
    lowest: float,
    space: float,
    depth: float,
    taps: wp.array[float],
    # outputs
    out: wp.array4d[float],
):
    """Forward to the native code."""


@_native.kernel("_grids_cuda.cu", OPTIONS, **NAMES)
def read_four(
    logs: wp.array2d[float],
    cells: wp.array4d[float],
    lowest: float,
    space: float,
    depth: float,
    # outputs
    out: wp.array2d[float],
    sums: wp.array2d[wp.int64],
):
    """Forward to the native code."""
