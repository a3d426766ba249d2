"""Sums of parts on CUDA, always in the same order: ``sums[n] += sum over p of parts[p, n]``.

A block takes 32 columns; each of its warps adds a share of the parts. _block_sum.cu has sums over
the threads of one block.
"""

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import BLOCK

wp.set_module_options({"enable_backward": False})

WARPS = BLOCK // 32


@_native.func_native("_sums_cuda.cu", WARPS=WARPS)
def add_up(parts: wp.array2d[float], sums: wp.array[float]): ...


@wp.kernel
def gather(
    parts: wp.array2d[float],  # (P, N), N a multiple of 32
    # outputs
    sums: wp.array[float],  # (N,): added to
):
    add_up(parts, sums)


def threads(columns: int) -> int:
    """Return the number of threads for `columns` columns, in blocks of BLOCK."""
    return columns // 32 * BLOCK
