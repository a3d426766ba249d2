"""Words that patches activate, and clusters of patches, in Warp: exact integers throughout."""

import math

import warp as wp

from cvkern.kernels.codes import recognition as codes
from cvkern.kernels.warp._launch import launch, launch_each, launch_slabs, scratch, slabs, view

from . import _words_cpu as cpu
from . import _words_cuda as cuda

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

NOBODY = wp.constant(codes.NOBODY)


def match_words(
    patches: wp.array, words: wp.array, least: int, products: wp.array, matches: wp.array
) -> None:
    """Find the words with the largest products of at least `least`, for each patch; a thread each.

    The largest comes first, and the smallest index wins a tie. Behind the last match is `NOBODY`,
    with the product 0.
    """
    count, size = patches.shape
    number, device = words.shape[0], patches.device
    if device.is_cuda:
        inputs, outputs = [patches, words, least], [products, matches]
        if device.arch < cuda.OLDEST or number == 0:
            launch(cuda.match_any, count, inputs, outputs)
            return
        inputs[:2] = [view(a, wp.uint32, (a.shape[0], size // 4)) for a in (patches, words)]
        blocks = -(-count // cuda.ROWS)
        kernel = cuda.match(size // 4, matches.shape[1])
        launch(kernel, blocks * cuda.THREADS, inputs, outputs, cuda.THREADS)
        return
    groups = -(-number // cpu.LANES)
    means = -(-((math.isqrt(size) // 2) ** 2) // 4) * 4
    packed = scratch("recognition.packed", (groups, cpu.LANES * (means + 4)), wp.int8, device)
    sums = scratch("recognition.sums", (groups, 3 * cpu.LANES), wp.int32, device)
    if groups:
        launch_slabs(cpu.pack, groups, slabs(groups, number * size), [words], [packed, sums])
    inputs = [patches, words, packed, sums, least]
    parts = slabs(count, count * number * size // 64)
    launch_slabs(cpu.match, count, min(count, 4 * parts) if parts > 1 else 1, inputs,
                 [products, matches])  # fmt: skip


def multiply_pairs(patches: wp.array, sums: wp.array) -> None:
    """Compute the product of each patch with each (N, N); a thread an element."""
    count = sums.size
    launch_each(_multiply, count, count * patches.shape[1] // 16, [patches], [sums])


@wp.kernel
def _multiply(
    stride: int,
    first: int,
    last: int,
    patches: wp.array2d[wp.int8],  # (N, D)
    # outputs
    sums: wp.array2d[wp.int64],  # (N, N)
):
    for item in range(first + wp.tid(), last, stride):
        i = item // sums.shape[1]
        j = item - i * sums.shape[1]
        dot = int(0)
        for k in range(patches.shape[1]):
            dot += int(patches[i, k]) * int(patches[j, k])
        sums[i, j] = wp.int64(dot)


def find_partners(
    sums: wp.array, sizes: wp.array, least: int, stale: wp.array, partners: wp.array
) -> None:
    """Find the most similar other cluster of each cluster that is marked in `stale` (N,).

    The similarity of two clusters is the mean product of their patches: sums[i, j] over both sizes.
    `partners` (N,) becomes `NOBODY` where none reaches `least`; the smallest index wins a tie. A
    cluster of size 0 does not count. One thread a cluster.
    """
    count = sizes.size
    inputs = [sums, sizes, wp.int64(least), stale]
    launch_each(_find, count, count * count, inputs, [partners])


@wp.kernel
def _find(
    stride: int,
    first: int,
    last: int,
    sums: wp.array2d[wp.int64],  # (N, N)
    sizes: wp.array[int],
    least: wp.int64,
    stale: wp.array[int],
    # outputs
    partners: wp.array[int],
):
    for i in range(first + wp.tid(), last, stride):
        if stale[i] == 1 and sizes[i] > 0:
            own = wp.int64(sizes[i])
            top = wp.int64(0)
            size = wp.int64(1)
            where = int(NOBODY)
            for j in range(sums.shape[1]):
                count = wp.int64(sizes[j])
                # The matrix is symmetric: neighbouring threads of a GPU read neighbouring columns.
                value = sums[i, j] if stride == 1 else sums[j, i]
                if j != i and count > wp.int64(0) and value >= least * own * count:
                    # Both sides times both sizes: value / count > top / size.
                    if where < 0 or value * size > top * count:
                        top = value
                        size = count
                        where = j
            partners[i] = where


def merge_clusters(pairs: wp.array, sums: wp.array, sizes: wp.array) -> None:
    """Merge the second cluster of each of P pairs into its first; no cluster is in two pairs.

    Rows of `sums` are added, then columns; a thread an element. The second one's size becomes 0.
    """
    count, size = pairs.shape[0], sums.shape[0]
    launch_each(_merge_rows, count * size, count * size, [pairs], [sums])
    launch_each(_merge_columns, count * size, count * size, [pairs], [sums])
    launch_each(_merge_sizes, count, count, [pairs], [sizes])


@wp.kernel
def _merge_rows(
    stride: int,
    first: int,
    last: int,
    pairs: wp.array2d[int],  # (P, 2)
    # outputs
    sums: wp.array2d[wp.int64],  # (N, N)
):
    for item in range(first + wp.tid(), last, stride):
        p = item // sums.shape[1]
        j = item - p * sums.shape[1]
        sums[pairs[p, 0], j] = sums[pairs[p, 0], j] + sums[pairs[p, 1], j]


@wp.kernel
def _merge_columns(
    stride: int,
    first: int,
    last: int,
    pairs: wp.array2d[int],  # (P, 2)
    # outputs
    sums: wp.array2d[wp.int64],  # (N, N)
):
    for item in range(first + wp.tid(), last, stride):
        i = item // pairs.shape[0]
        p = item - i * pairs.shape[0]
        sums[i, pairs[p, 0]] = sums[i, pairs[p, 0]] + sums[i, pairs[p, 1]]


@wp.kernel
def _merge_sizes(
    stride: int,
    first: int,
    last: int,
    pairs: wp.array2d[int],  # (P, 2)
    # outputs
    sizes: wp.array[int],
):
    for p in range(first + wp.tid(), last, stride):
        sizes[pairs[p, 0]] = sizes[pairs[p, 0]] + sizes[pairs[p, 1]]
        sizes[pairs[p, 1]] = 0
