"""Words that patches activate, and clusters of patches, in Taichi: exact integers throughout."""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.recognition import NOBODY
from cvkern.kernels.taichi._launch import primitive

i8_2 = ti.types.ndarray(dtype=ti.i8, ndim=2)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
i64_2 = ti.types.ndarray(dtype=ti.i64, ndim=2)


@primitive
def match_words(
    patches: np.ndarray, words: np.ndarray, least: int, products: np.ndarray, matches: np.ndarray
) -> None:
    """Find the words with the largest products of at least `least`, for each patch; a thread each.

    The largest comes first, and the smallest index wins a tie. Behind the last match is `NOBODY`,
    with the product 0.
    """
    _match(patches, words, least, products, matches)


@ti.kernel
def _match(
    patches: i8_2,  # (N, D)
    words: i8_2,  # (K, D)
    least: ti.i32,
    # outputs
    products: i32_2,  # (N, M)
    matches: i32_2,  # (N, M)
):
    for i in range(patches.shape[0]):
        most = matches.shape[1]
        found = 0
        for word in range(words.shape[0]):
            dot = 0
            for k in range(patches.shape[1]):
                dot += ti.cast(patches[i, k], ti.i32) * ti.cast(words[word, k], ti.i32)
            if dot >= least and (found < most or dot > products[i, most - 1]):
                at = ti.min(found, most - 1)
                while at > 0 and products[i, ti.max(at - 1, 0)] < dot:
                    products[i, at] = products[i, at - 1]
                    matches[i, at] = matches[i, at - 1]
                    at -= 1
                products[i, at] = dot
                matches[i, at] = word
                found = ti.min(found + 1, most)
        for m in range(found, most):
            products[i, m] = 0
            matches[i, m] = NOBODY


@primitive
def multiply_pairs(patches: np.ndarray, sums: np.ndarray) -> None:
    """Compute the product of each patch with each (N, N); a thread an element."""
    _multiply(patches, sums)


@ti.kernel
def _multiply(
    patches: i8_2,  # (N, D)
    # outputs
    sums: i64_2,  # (N, N)
):
    for i, j in sums:
        dot = 0
        for k in range(patches.shape[1]):
            dot += ti.cast(patches[i, k], ti.i32) * ti.cast(patches[j, k], ti.i32)
        sums[i, j] = dot


@primitive
def find_partners(
    sums: np.ndarray, sizes: np.ndarray, least: int, stale: np.ndarray, partners: np.ndarray
) -> None:
    """Find the most similar other cluster of each cluster that is marked in `stale` (N,).

    The similarity of two clusters is the mean product of their patches: sums[i, j] over both sizes.
    `partners` (N,) becomes `NOBODY` where none reaches `least`; the smallest index wins a tie. A
    cluster of size 0 does not count. One thread a cluster.
    """
    _find(sums, sizes, least, stale, partners)


@ti.kernel
def _find(
    sums: i64_2,
    sizes: i32_1,
    least: ti.i64,
    stale: i32_1,
    # outputs
    partners: i32_1,
):
    for i in range(sums.shape[0]):
        if stale[i] == 1 and sizes[i] > 0:
            top = ti.cast(0, ti.i64)
            size = ti.cast(1, ti.i64)
            where = NOBODY
            for j in range(sums.shape[1]):
                count = ti.cast(sizes[j], ti.i64)
                if count > 0 and j != i and sums[i, j] >= least * sizes[i] * count:
                    # Both sides times both sizes: sums[i, j] / count > top / size.
                    if where == NOBODY or sums[i, j] * size > top * count:
                        top = sums[i, j]
                        size = count
                        where = j
            partners[i] = where


@primitive
def merge_clusters(pairs: np.ndarray, sums: np.ndarray, sizes: np.ndarray) -> None:
    """Merge the second cluster of each of P pairs into its first; no cluster is in two pairs.

    Rows of `sums` are added, then columns; a thread an element. The second one's size becomes 0.
    """
    _merge(pairs, sums, sizes)


@ti.kernel
def _merge(
    pairs: i32_2,  # (P, 2)
    # outputs
    sums: i64_2,
    sizes: i32_1,
):
    for p, j in ti.ndrange(pairs.shape[0], sums.shape[1]):
        sums[pairs[p, 0], j] += sums[pairs[p, 1], j]
    for i, p in ti.ndrange(sums.shape[0], pairs.shape[0]):
        sums[i, pairs[p, 0]] += sums[i, pairs[p, 1]]
    for p in range(pairs.shape[0]):
        sizes[pairs[p, 0]] += sizes[pairs[p, 1]]
        sizes[pairs[p, 1]] = 0
