"""Nearest descriptors on CUDA. matching.py has the rule.

Tensor cores compare descriptors of SIFT's and ORB's sizes (_matching_cuda.cu); of other sizes a
thread takes a row.
"""

import warp as wp

from cvkern.kernels.codes.features import BLOCK_ROWS, FARTHEST
from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

LARGEST = wp.constant(FARTHEST)
FEW = 256  # blocks of half of BLOCK_ROWS that do not fill a GPU
# Threads of a block, and its rows: other rows are read once for all rows of a block. Where blocks
# are few, more warps share the other rows.
MANY_BLOCKS, FEW_BLOCKS = (128, BLOCK_ROWS), (512, BLOCK_ROWS // 2)
OLDEST = 80  # architecture: `mma` has the products of bits since then
SIZES = {(0, 128): 32, (1, 32): 8}  # words of a descriptor, by whether it is binary and its bytes


def _match(binary: int, words: int, threads: int, rows: int) -> wp.Kernel:
    """Return the kernel for descriptors of so many words."""

    @_native.kernel(
        "_matching_cuda.cu",
        {},
        launch_bounds=(threads, 512 // threads or 1),
        WORDS=words,
        WARPS=threads // 32,
        ROWS=rows,
        BLOCK_ROWS=BLOCK_ROWS,
        BINARY=binary,
        FARTHEST=FARTHEST,
    )
    def match(
        words: wp.array2d[wp.uint32],  # (T, K / 4)
        blocks: wp.array2d[int],  # (B, 5)
        # outputs
        best: wp.array[int],
        second: wp.array[int],
        index: wp.array[int],
    ): ...

    return match


matches = {
    (*kind, *shape): _match(kind[0], words, *shape)
    for kind, words in SIZES.items()
    for shape in (MANY_BLOCKS, FEW_BLOCKS)
}


@wp.func
def dot4(a: wp.uint32, b: wp.uint32, sum: wp.uint32) -> wp.uint32:
    """Add the products of four pairs of bytes."""
    for i in range(4):
        shift = wp.uint32(8 * i)
        sum += ((a >> shift) & wp.uint32(255)) * ((b >> shift) & wp.uint32(255))
    return sum


@wp.kernel
def match_any(
    words: wp.array2d[wp.uint32],  # (T, K / 4)
    blocks: wp.array2d[int],  # (B, 5)
    rows: int,
    binary: int,
    # outputs
    best: wp.array[int],
    second: wp.array[int],
    index: wp.array[int],
):
    item = wp.tid()
    block = item // rows
    row = blocks[block, 0] + item - block * rows
    if row >= blocks[block, 1]:
        return
    own = wp.uint32(0)
    for k in range(words.shape[1]):
        own = dot4(words[row, k], words[row, k], own)
    top = int(LARGEST)
    other = int(LARGEST)
    where = int(0)
    for j in range(blocks[block, 2], blocks[block, 3]):
        d = int(0)
        if binary == 1:
            for k in range(words.shape[1]):
                d += int(wp.bit_count(words[row, k] ^ words[j, k]))
        else:
            dot = wp.uint32(0)
            norm = wp.uint32(0)
            for k in range(words.shape[1]):
                dot = dot4(words[row, k], words[j, k], dot)
                norm = dot4(words[j, k], words[j, k], norm)
            d = int(own) + int(norm) - 2 * int(dot)
        if d < top:
            other = top
            top = d
            where = j - blocks[block, 2]
        elif d < other:
            other = d
    out = blocks[block, 4] + row - blocks[block, 0]
    best[out] = top
    second[out] = other
    index[out] = where
