"""Reading of a bilateral grid on CUDA, in native code: four pixels a thread."""

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp.raw._tone_cuda import OPTIONS, SUMS


@_native.kernel("_grids_cuda.cu", OPTIONS, **SUMS)
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
