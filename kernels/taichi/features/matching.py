"""Nearest descriptors by exact distances, in Taichi; the smallest index wins a tie."""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.features import BLOCK_ROWS, FARTHEST
from cvkern.kernels.taichi._launch import primitive

i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)


@primitive
def find_nearest(
    descriptors: np.ndarray,
    blocks: np.ndarray,
    binary: int,
    best: np.ndarray,
    second: np.ndarray,
    index: np.ndarray,
) -> None:
    """Find the two nearest of other rows for the rows of each block; a thread a row.

    A block is (first row, row behind the last, first of the other rows, the one behind their
    last, place of its first result). Distances are squared, or the number of differing bits.
    """
    _match(descriptors, blocks, binary, best, second, index)


@ti.kernel
def _match(
    descriptors: u8_2,  # (T, K)
    blocks: i32_2,  # (B, 5)
    binary: ti.i32,
    # outputs
    best: i32_1,
    second: i32_1,
    index: i32_1,
):
    for block, step in ti.ndrange(blocks.shape[0], BLOCK_ROWS):
        row = blocks[block, 0] + step
        if row < blocks[block, 1]:
            top = FARTHEST
            other = FARTHEST
            where = 0
            for j in range(blocks[block, 2], blocks[block, 3]):
                d = 0
                for k in range(descriptors.shape[1]):
                    a = ti.cast(descriptors[row, k], ti.i32)
                    b = ti.cast(descriptors[j, k], ti.i32)
                    if binary == 1:
                        d += ti.math.popcnt(a ^ b)
                    else:
                        d += (a - b) * (a - b)
                if d < top:
                    other = top
                    top = d
                    where = j - blocks[block, 2]
                elif d < other:
                    other = d
            out = blocks[block, 4] + step
            best[out] = top
            second[out] = other
            index[out] = where
