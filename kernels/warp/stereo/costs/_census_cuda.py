"""Census and Hamming distance on CUDA: one thread per pixel, and threads along the disparities.

census.py describes the transform. The code is native, so that most pixels skip the arithmetic of
borders, and the distances of a tile are stored in order.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import launch

from ._windows_cpu import C_TYPES, OPTIONS

_BLOCK = 256
_TILE = 16  # pixels whose distances a block computes


@lru_cache
def census_kernel(scalar: Any) -> wp.Kernel:
    """Return the kernel for values of one type; it is compiled at the first use."""

    @_native.kernel("_census_cuda.cu", OPTIONS, TYPE=C_TYPES[scalar], BLOCK=_BLOCK)
    def census(
        image: wp.array3d[scalar],  # (H, W, C)
        radius_y: int,
        radius_x: int,
        spacing: int,
        symmetric: bool,
        # outputs
        bits: wp.array3d[wp.uint64],  # (H, W, C)
    ): ...

    return census


@_native.kernel("_census_cuda.cu", OPTIONS, BLOCK=_BLOCK, TILE=_TILE)
def distances(
    left: wp.array3d[wp.uint64],  # (H, W, C)
    right: wp.array3d[wp.uint64],  # (H, W, C)
    first: int,
    # outputs
    costs: wp.array3d[wp.uint8],  # (H, W, D)
): ...


def census(
    image: wp.array, radius_y: int, radius_x: int, spacing: int, symmetric: bool, bits: wp.array
) -> None:
    """Launch a thread for each value."""
    count = -(-image.size // _BLOCK) * _BLOCK
    inputs = [image, radius_y, radius_x, spacing, symmetric]
    launch(census_kernel(image.dtype), count, inputs, [bits])


def hamming(left: wp.array, right: wp.array, first: int, costs: wp.array) -> None:
    """Launch a block for each tile of a row."""
    blocks = left.shape[0] * -(-left.shape[1] // _TILE)
    launch(distances, blocks * _BLOCK, [left, right, first], [costs])
