"""FAST corners and binary descriptors on the CPU: a thread takes a slab of rows or of corners.

The code (_binary_cpu.h) is native, because it compares vectors of 64 bytes, and leaves early where
none of them is a corner.
"""

import warp as wp

from cvkern.kernels.codes import features as codes
from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

FILE = "_binary_cpu.h"
# Constants of the native code, on CUDA as well.
DESCRIBE = {
    "DISC": codes.DISC,
    "BLUR": codes.BLUR,
    "PAIRS": codes.PAIRS,
    "TURNS": codes.TURNS,
    "TURNS_PER_RADIAN": f"{codes.TURNS_PER_RADIAN!r}f",
}


@_native.func_native(FILE)
def mark_rows(
    slab: int,
    first: int,
    last: int,
    src: wp.array2d[wp.uint8],
    threshold: int,
    margin: int,
    lines: wp.array2d[wp.uint8],
    words: wp.array3d[int],
    counts: wp.array[int],
): ...


@_native.func_native(FILE)
def list_row(
    row: int,
    src: wp.array2d[wp.uint8],
    words: wp.array3d[int],
    ends: wp.array[int],
    image: int,
    before: int,
    cells: wp.array2d[int],
    responses: wp.array[wp.int64],
): ...


@_native.func_native(FILE, **DESCRIBE)
def describe_one(
    k: int,
    images: wp.array2d[wp.int64],
    taps: wp.array[float],
    cells: wp.array2d[int],
    pattern: wp.array3d[int],
    upright: int,
    angles: wp.array[float],
    descriptors: wp.array2d[wp.uint8],
): ...


@_native.func_native(FILE)
def round_row(row: int, src: wp.array2d[float], dst: wp.array2d[wp.uint8]): ...


@wp.kernel
def round_values(
    slab: int,
    first: int,
    last: int,
    src: wp.array2d[float],
    # outputs
    dst: wp.array2d[wp.uint8],
):
    for row in range(first, last):
        round_row(row, src, dst)


@wp.kernel
def mark(
    slab: int,
    first: int,
    last: int,
    src: wp.array2d[wp.uint8],
    threshold: int,
    margin: int,
    # scratch
    lines: wp.array2d[wp.uint8],  # (3 slabs, W and 64 on both sides)
    # outputs
    words: wp.array3d[int],  # (1, H, ceil(W / 32))
    counts: wp.array[int],
):
    mark_rows(slab, first, last, src, threshold, margin, lines, words, counts)


@wp.kernel
def gather(
    slab: int,
    first: int,
    last: int,
    src: wp.array2d[wp.uint8],
    words: wp.array3d[int],
    ends: wp.array[int],
    image: int,
    before: int,  # rows of larger images
    # outputs
    cells: wp.array2d[int],  # (N, 4)
    responses: wp.array[wp.int64],
):
    for row in range(first, last):
        list_row(row, src, words, ends, image, before, cells, responses)


@wp.kernel
def describe(
    slab: int,
    first: int,
    last: int,
    images: wp.array2d[wp.int64],  # (O, 4)
    taps: wp.array[float],
    cells: wp.array2d[int],  # (N, 4)
    pattern: wp.array3d[int],  # (TURNS, PAIRS, 4): row, column, row, column
    upright: int,
    # outputs
    angles: wp.array[float],
    descriptors: wp.array2d[wp.uint8],
):
    for k in range(first, last):
        describe_one(k, images, taps, cells, pattern, upright, angles, descriptors)
