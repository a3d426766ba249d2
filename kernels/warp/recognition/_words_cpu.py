"""Words of patches on the CPU: 16 words at once, and exact products where coarse ones are large.

With 2000 words, 70 000 patches of 16 x 16 pixels take 105 ms of one core; with exact products of
all, 225 ms.
"""

import warp as wp

from cvkern.kernels.codes.recognition import LARGEST_PATCH, MOST_WORDS
from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

FILE = "_words_cpu.h"
LANES = 16
ROWS = 8  # patches at once


@_native.func_native(FILE, LANES=LANES, ROWS=ROWS, LARGEST=LARGEST_PATCH)
def pack_group(
    group: int, words: wp.array2d[wp.int8], packed: wp.array2d[wp.int8], sums: wp.array2d[int]
): ...


@_native.func_native(FILE, LANES=LANES, ROWS=ROWS, MOST=MOST_WORDS, LARGEST=LARGEST_PATCH)
def match_rows(
    first: int,
    last: int,
    patches: wp.array2d[wp.int8],
    words: wp.array2d[wp.int8],
    packed: wp.array2d[wp.int8],
    sums: wp.array2d[int],
    least: int,
    products: wp.array2d[int],
    matches: wp.array2d[int],
): ...


@wp.kernel
def pack(
    slab: int,
    first: int,
    last: int,
    words: wp.array2d[wp.int8],  # (K, D)
    # outputs
    packed: wp.array2d[wp.int8],  # (G, 16 (C + 4)): C means of each word, and its bound
    sums: wp.array2d[int],  # (G, 3 16)
):
    for group in range(first, last):
        pack_group(group, words, packed, sums)


@wp.kernel
def match(
    slab: int,
    first: int,
    last: int,
    patches: wp.array2d[wp.int8],  # (N, D)
    words: wp.array2d[wp.int8],  # (K, D)
    packed: wp.array2d[wp.int8],
    sums: wp.array2d[int],
    least: int,
    # outputs
    products: wp.array2d[int],  # (N, M)
    matches: wp.array2d[int],  # (N, M)
):
    match_rows(first, last, patches, words, packed, sums, least, products, matches)
