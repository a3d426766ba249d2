"""Layers of a perceptron on CUDA, in float16 on the tensor cores.

``dst = src w``, and ``src^T dy`` for the gradient of w. A warp keeps 16 samples in registers, as
`mma.m16n8k16` needs them: lane 4 g + t has samples g and g + 8. We may choose which column of a
matrix is which k or n of the instruction, if both operands agree. Here the four columns of a lane
in each group of 16 are 4 t to 4 t + 3, which are adjacent in memory. An 8 x 8 piece has columns 4 t
and 4 t + 1 of these, or 4 t + 2 and 4 t + 3.
"""

from functools import cache

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import BLOCK

from ._product import Product

WARPS = BLOCK // 32
TILE = 64  # most columns that a block computes
OPTIONS = {"enable_backward": False}


def tile(size: int) -> int:
    """Return the largest tile that divides a multiple of 16 evenly."""
    return max(part for part in range(16, TILE + 1, 16) if size % part == 0)


@cache
def product(depth: int, tile: int, transposed: bool) -> wp.Kernel:
    """Return the kernel of ``dst = src w`` for a depth, in tiles of `tile` columns."""
    sizes = {"K_SIZE": depth, "N_SIZE": tile, "TRANSPOSED": int(transposed), "WARPS": WARPS}

    @_native.kernel("_layers_cuda.cu", OPTIONS, **sizes)
    def multiply(
        src: wp.array2d[wp.float16],  # (M, >= depth)
        w: wp.array2d[wp.float16],  # (depth, columns), or the other way round where transposed
        gates: wp.array2d[wp.float16],  # (M, columns)
        total: wp.array[int],  # (1,)
        product: Product,
        dst: wp.array2d[wp.float16],  # (M, >= columns): filled
    ): ...

    return multiply


@cache
def outer(depth: int, columns: int) -> wp.Kernel:
    """Return the kernel of P parts of ``src^T dy``, in tiles of depth x columns."""

    @_native.kernel("_layers_cuda.cu", OPTIONS, K_SIZE=depth, N_SIZE=columns, WARPS=WARPS)
    def accumulate(
        dy: wp.array2d[wp.float16],  # (M, >= columns)
        src: wp.array2d[wp.float16],  # (M, >= K)
        total: wp.array[int],  # (1,)
        column: int,
        parts: wp.array3d[float],  # (P, K, N): filled
    ): ...

    return accumulate
