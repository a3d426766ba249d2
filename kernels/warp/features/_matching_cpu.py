"""Nearest descriptors on the CPU: rows of one image against 16 of another at once.

The code (_matching_cpu.h) is native for dot products of bytes and counts of bits in vectors.
"""

import warp as wp

from cvkern.kernels.codes.features import FARTHEST
from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

FILE = "_matching_cpu.h"
LANES = 16
ROWS = 8  # rows at once


@_native.each(FILE, LANES=LANES, ROWS=ROWS, LARGEST=FARTHEST)
def pack_group(
    group: int,
    descriptors: wp.array2d[wp.uint8],  # (T, K)
    groups: wp.array2d[int],  # (G, 2): first row, count
    binary: int,
    # outputs
    packed: wp.array2d[wp.uint8],  # (G, 16 K)
    norms: wp.array2d[int],  # (G, 16)
): ...


@_native.each(FILE, LANES=LANES, ROWS=ROWS, LARGEST=FARTHEST)
def match_block(
    block: int,
    descriptors: wp.array2d[wp.uint8],  # (T, K)
    blocks: wp.array2d[int],  # (B, 5)
    group_of: wp.array[int],  # (B,): the first group of its image
    binary: int,
    packed: wp.array2d[wp.uint8],
    norms: wp.array2d[int],
    # outputs
    best: wp.array[int],
    second: wp.array[int],
    index: wp.array[int],
): ...
