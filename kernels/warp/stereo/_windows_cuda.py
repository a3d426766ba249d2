"""Matching by windows on CUDA: one block per tile of columns, which moves down a strip of rows.

The sums of Hamming distances down the columns stay in shared memory, two disparities in a word. No
half of a word is ever negative or needs more than 16 bits, so whole words are added. A warp sums
them along the row, one thread per group of disparities, and picks the winner of each pixel. The
winner of a right pixel is the minimum of keys, with the cost in the high bits and the disparity in
the low bits.
"""

from functools import lru_cache

import warp as wp

from cvkern.kernels.codes.stereo import Rule, Winners
from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import launch, scratch
from cvkern.kernels.warp._structs import struct_of

from ._winner import CURVES, OPTIONS, WinnerArrays, WinnerRule
from .costs._windows_cpu import Windows

wp.set_module_options(OPTIONS)

WORDS = (1, 2, 4, 8)  # possible numbers of words, of two disparities each, per thread
_BLOCK = 256
_SHARED_WORDS = 9216  # words of the sums: 36 KiB of the 48 KiB of a block
_FEWEST_COLUMNS = 16  # fewest columns of a tile, without the reach of its windows
_BLOCKS = 1056  # blocks that keep a large GPU busy


def columns_of(words: int) -> int:
    """Return the number of columns of sums that fit into shared memory."""
    return _SHARED_WORDS // (32 * words)


@lru_cache
def match_kernel(words: int) -> wp.Kernel:
    """Return the kernel for up to 64 `words` disparities; it is compiled at the first use."""
    needs = {"WORDS": words, "COLUMNS": columns_of(words), "BLOCK": _BLOCK, "WIDE": wp.int32}

    @_native.kernel("_windows_cuda.cu", OPTIONS, launch_bounds=(_BLOCK, 4), **needs, **CURVES)
    def match(
        left: wp.array3d[wp.uint64],  # (H, W, 1), no more than 32 bits each
        right: wp.array3d[wp.uint64],
        count: int,
        windows: Windows,
        rule: WinnerRule,
        rows: int,  # rows that a block computes
        # outputs, (H, W)
        winners: WinnerArrays,
        keys: wp.array2d[wp.uint32],  # keys of the right image, all bits set before
    ): ...

    return match


@wp.kernel
def clear_keys(
    # outputs
    keys: wp.array[wp.uint32],
):
    keys[wp.tid()] = wp.uint32(0xFFFFFFFF)


@wp.kernel
def disparities_of_keys(
    keys: wp.array[wp.uint32],
    # outputs
    index: wp.array[int],
):
    i = wp.tid()
    index[i] = wp.where(keys[i] == wp.uint32(0xFFFFFFFF), -1, int(keys[i] & wp.uint32(0xFFFF)))


def words_for(count: int, radius_x: int) -> int:
    """Return the number of words per thread; 0 if no kernel has room for the disparities."""
    fitting = (words for words in WORDS if count <= 64 * words)
    words = next(fitting, 0)
    return words if words and columns_of(words) >= 2 * radius_x + _FEWEST_COLUMNS else 0


def match_words(
    left: wp.array,
    right: wp.array,
    count: int,
    windows: Windows,
    rule: Rule,
    winners: Winners,
    right_index: wp.array,
) -> None:
    """Match descriptors (H, W, 1) of 32 bits; `words_for` must allow it."""
    height, width, _ = left.shape
    words = words_for(count, windows.radius_x)
    tiles = -(-width // (columns_of(words) - 2 * windows.radius_x))
    rows = max(8, min(64, -(-height * tiles // _BLOCKS)))
    keys = scratch("match.keys", (height, width), wp.uint32, left.device)
    launch(clear_keys, keys.size, [], [keys.flatten()])
    launch(
        match_kernel(words),
        tiles * -(-height // rows) * _BLOCK,
        [left, right, count, windows, struct_of(WinnerRule, rule), rows],
        [struct_of(WinnerArrays, winners), keys],
    )
    launch(disparities_of_keys, keys.size, [keys.flatten()], [right_index.flatten()])
