"""Nearest descriptors by exact distances, and the matches among them, in Taichi.

The distance of two descriptors is ``|a|^2 + |b|^2 - 2 a . b`` in integers, or the number of bits
that differ. The smallest index wins a tie. A match is kept if its distance is below a share of the
second smallest, and if each descriptor is the other's nearest [D. G. Lowe, IJCV 60(2), 2004]. The
kept ones are counted by a prefix sum, so that matches are in the order of their rows. One thread
takes a row.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.features import BLOCK_ROWS, FARTHEST
from cvkern.kernels.taichi._launch import primitive

i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)


@primitive
def pack_descriptors(src: np.ndarray, first: int, dst: np.ndarray) -> None:
    """Copy descriptors (N, D) to the rows of `dst` (T, K) from `first` on, with zeros behind them.

    One thread a byte.
    """
    _pack(src, first, dst)


@ti.kernel
def _pack(
    src: u8_2,
    first: ti.i32,
    # outputs
    dst: u8_2,
):
    for row, k in ti.ndrange(src.shape[0], dst.shape[1]):
        value = ti.u8(0)
        if k < src.shape[1]:
            value = src[row, k]
        dst[first + row, k] = value


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


@primitive
def keep_matches(
    pairs: np.ndarray,
    most: int,
    factor: float,
    best: np.ndarray,
    second: np.ndarray,
    index: np.ndarray,
    counts: np.ndarray,
    ends: np.ndarray,
) -> None:
    """Count the matches up to each of R rows of P pairs, and up to the end of each pair.

    A pair is (number of rows, at most `most`; place of its first result; place of the first result
    of the other way, or -1; its first row of the R). A row is a match if its best distance is below
    `factor` times the second, unless that is 1, and if the result of the other way agrees. One
    thread a row, then a sum by one thread.
    """
    _keep(pairs, most, factor, best, second, index, counts)
    _count(pairs, counts, ends)


@ti.kernel
def _keep(
    pairs: i32_2,  # (P, 4)
    most: ti.i32,
    factor: ti.f64,
    best: i32_1,
    second: i32_1,
    index: i32_1,
    # outputs
    kept: i32_1,
):
    for pair, row in ti.ndrange(pairs.shape[0], most):
        if row < pairs[pair, 0]:
            at = pairs[pair, 1] + row
            found = 1
            if factor < 1.0 and ti.cast(best[at], ti.f64) >= factor * ti.cast(second[at], ti.f64):
                found = 0
            if pairs[pair, 2] >= 0:
                if index[pairs[pair, 2] + index[at]] != row:
                    found = 0
            kept[pairs[pair, 3] + row] = found


@ti.kernel
def _count(
    pairs: i32_2,  # (P, 4)
    # outputs
    counts: i32_1,  # 0 or 1 before
    ends: i32_1,  # (P,)
):
    for _ in range(1):
        count = 0
        for pair in range(pairs.shape[0]):
            for row in range(pairs[pair, 0]):
                count += counts[pairs[pair, 3] + row]
                counts[pairs[pair, 3] + row] = count
            ends[pair] = count


@primitive
def write_matches(
    pairs: np.ndarray, most: int, index: np.ndarray, counts: np.ndarray, matches: np.ndarray
) -> None:
    """List the M matches that `keep_matches` counted: a row and its nearest; a thread a row."""
    _write(pairs, most, index, counts, matches)


@ti.kernel
def _write(
    pairs: i32_2,  # (P, 4)
    most: ti.i32,
    index: i32_1,
    counts: i32_1,
    # outputs
    matches: i32_2,
):
    for pair, row in ti.ndrange(pairs.shape[0], most):
        if row < pairs[pair, 0]:
            i = pairs[pair, 3] + row
            before = 0
            if i > 0:
                before = counts[i - 1]
            if counts[i] > before:
                matches[before, 0] = row
                matches[before, 1] = index[pairs[pair, 1] + row]
