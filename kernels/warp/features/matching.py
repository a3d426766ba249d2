"""Nearest descriptors by exact distances, and the matches among them, in Warp.

The distance of two descriptors is ``|a|^2 + |b|^2 - 2 a . b`` in integers, or the number of bits
that differ. The smallest index wins a tie. A match is kept if its distance is below a share of the
second smallest, and if each descriptor is the other's nearest [D. G. Lowe, IJCV 60(2), 2004]. The
kept ones are counted by a prefix sum, so that matches are in the order of their rows. One thread
takes a row. On the CPU a thread takes a slab of rows of
descriptors (_matching_cpu.h). On CUDA, tensor cores compare those of SIFT's and ORB's sizes
(_matching_cuda.cu); of others a thread takes a row.
"""

import numpy as np
import warp as wp

from cvkern.kernels.codes.features import BLOCK_ROWS
from cvkern.kernels.warp._launch import launch, launch_slabs, scratch, slabs, view
from cvkern.kernels.warp._sums import scan

from . import _matching_cpu as cpu
from . import _matching_cuda as cuda

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def _pack(
    src: wp.array2d[wp.uint8],  # (N, D)
    first: int,
    # outputs
    dst: wp.array2d[wp.uint8],  # (T, K)
):
    row, k = wp.tid()
    value = wp.uint8(0)
    if k < src.shape[1]:
        value = src[row, k]
    dst[first + row, k] = value


def pack_descriptors(src: wp.array, first: int, dst: wp.array) -> None:
    """Copy descriptors (N, D) to the rows of `dst` (T, K) from `first` on, with zeros behind them.

    One thread a byte.
    """
    launch(_pack, (src.shape[0], dst.shape[1]), [src, first], [dst])


def find_nearest(
    descriptors: wp.array,
    blocks: wp.array,
    binary: int,
    best: wp.array,
    second: wp.array,
    index: wp.array,
) -> None:
    """Find the two nearest of other rows for the rows of each block; a thread a row.

    A block is (first row, row behind the last, first of the other rows, the one behind their
    last, place of its first result). Distances are squared, or the number of differing bits.
    """
    count = blocks.shape[0]
    rows, size = descriptors.shape
    if descriptors.device.is_cuda:
        words = view(descriptors, wp.uint32, (rows, size // 4))
        outputs = [best, second, index]
        shape = cuda.FEW_BLOCKS if 2 * count <= cuda.FEW else cuda.MANY_BLOCKS
        match = cuda.matches.get((binary, size, *shape))
        if match is not None and descriptors.device.arch >= cuda.OLDEST:
            threads, part = shape
            launch(match, BLOCK_ROWS // part * count * threads, [words, blocks], outputs, threads)
            return
        inputs = [words, blocks, BLOCK_ROWS, binary]
        launch(cuda.match_any, count * BLOCK_ROWS, inputs, outputs, BLOCK_ROWS)
        return
    others = blocks.numpy()[:, 2:4]
    images, image_of = np.unique(others, axis=0, return_inverse=True)
    groups = [
        (first, min(cpu.LANES, last - first))
        for begin, last in images.tolist()
        for first in range(begin, last, cpu.LANES)
    ]
    counts = -(-(images[:, 1] - images[:, 0]) // cpu.LANES)
    begins = np.r_[0, np.cumsum(counts)[:-1]][image_of.reshape(-1)]
    number = len(groups)
    table = wp.array(np.array(groups, np.int32), dtype=wp.int32, device="cpu")
    group_of = wp.array(begins.astype(np.int32), dtype=wp.int32, device="cpu")
    device = descriptors.device
    packed = scratch("matching.packed", (number, cpu.LANES * size), wp.uint8, device)
    norms = scratch("matching.norms", (number, cpu.LANES), wp.int32, device)
    parts = slabs(number, number * cpu.LANES * size)
    launch_slabs(cpu.pack_group, number, parts, [descriptors, table, binary], [packed, norms])
    work = int((others[:, 1] - others[:, 0]).sum()) * BLOCK_ROWS * size // 16
    inputs = [descriptors, blocks, group_of, binary, packed, norms]
    launch_slabs(cpu.match_block, count, min(count, 4 * slabs(count, work)), inputs,
                 [best, second, index])  # fmt: skip


@wp.kernel
def _keep(
    pairs: wp.array2d[int],  # (P, 4)
    factor: wp.float64,
    best: wp.array[int],
    second: wp.array[int],
    index: wp.array[int],
    # outputs
    kept: wp.array[int],
):
    pair, row = wp.tid()
    if row >= pairs[pair, 0]:
        return
    at = pairs[pair, 1] + row
    found = int(1)
    if factor < wp.float64(1.0):
        if wp.float64(best[at]) >= factor * wp.float64(second[at]):
            found = 0
    if pairs[pair, 2] >= 0:
        if index[pairs[pair, 2] + index[at]] != row:
            found = 0
    kept[pairs[pair, 3] + row] = found


@wp.kernel
def _end(
    pairs: wp.array2d[int],  # (P, 4)
    counts: wp.array[int],
    # outputs
    ends: wp.array[int],  # (P,)
):
    pair = wp.tid()
    last = pairs[pair, 3] + pairs[pair, 0] - 1
    end = int(0)
    if last >= 0:
        end = counts[last]
    ends[pair] = end


def keep_matches(
    pairs: wp.array,
    most: int,
    factor: float,
    best: wp.array,
    second: wp.array,
    index: wp.array,
    counts: wp.array,
    ends: wp.array,
) -> None:
    """Count the matches up to each of R rows of P pairs, and up to the end of each pair.

    A pair is (number of rows, at most `most`; place of its first result; place of the first result
    of the other way, or -1; its first row of the R). A row is a match if its best distance is below
    `factor` times the second, unless that is 1, and if the result of the other way agrees. One
    thread a row, then a prefix sum.
    """
    pair_count = pairs.shape[0]
    inputs = [pairs, wp.float64(factor), best, second, index]
    launch(_keep, (pair_count, most), inputs, [counts])
    scan(counts)
    launch(_end, pair_count, [pairs, counts], [ends])


@wp.kernel
def _write(
    pairs: wp.array2d[int],  # (P, 4)
    index: wp.array[int],
    counts: wp.array[int],
    # outputs
    matches: wp.array2d[int],
):
    pair, row = wp.tid()
    if row >= pairs[pair, 0]:
        return
    i = pairs[pair, 3] + row
    before = int(0)
    if i > 0:
        before = counts[i - 1]
    if counts[i] > before:
        matches[before, 0] = row
        matches[before, 1] = index[pairs[pair, 1] + row]


def write_matches(
    pairs: wp.array, most: int, index: wp.array, counts: wp.array, matches: wp.array
) -> None:
    """List the M matches that `keep_matches` counted: a row and its nearest; a thread a row."""
    launch(_write, (pairs.shape[0], most), [pairs, index, counts], [matches])
