"""The mean of an occupancy grid, and which cells are above it, on CUDA."""

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp.radiance._sums_cuda import WARPS

wp.set_module_options({"enable_backward": False})

BLOCKS = 1024  # blocks that mark, at most


@_native.func_native("_occupancy_cuda.cu", WARPS=WARPS)
def sum_cells(density: wp.array[float], parts: wp.array[float]): ...


@_native.func_native("_occupancy_cuda.cu", WARPS=WARPS)
def mark_cells(
    density: wp.array[float],
    parts: wp.array[float],
    least: float,
    limit: wp.array[float],
    bits: wp.array[wp.uint32],
): ...


@wp.kernel
def sum_parts(
    density: wp.array[float],  # (count,)
    # outputs
    parts: wp.array[float],  # (P,)
):
    """Sum a share of the cells in each block."""
    sum_cells(density, parts)


@wp.kernel
def mark(
    density: wp.array[float],  # (count,)
    parts: wp.array[float],  # (P,)
    least: float,
    # outputs
    limit: wp.array[float],  # (1,)
    bits: wp.array[wp.uint32],  # (count / 32,)
):
    """Compute the mean from the parts in each block, and set bits."""
    mark_cells(density, parts, least, limit, bits)
