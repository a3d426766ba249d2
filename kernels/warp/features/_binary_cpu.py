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
    "TAPS": ", ".join(map(str, codes.BLUR_TAPS)),
    "REACH": codes.PATTERN_REACH,
    "PITCH": codes.PATTERN_PITCH,
    "PAIRS": codes.PAIRS,
    "TURNS": codes.TURNS,
    "TURNS_PER_RADIAN": f"{codes.TURNS_PER_RADIAN!r}f",
}


@_native.func_native("_sizes_cpu.h")
def make_sizes(
    images: wp.array2d[wp.int64],
    starts: wp.array[int],
    weights: wp.array2d[wp.uint8],
    shared: wp.array[int],
): ...


@_native.func_native(FILE)
def mark_rows(
    slab: int,
    start: int,
    stop: int,
    images: wp.array2d[wp.int64],
    threshold: int,
    margin: int,
    lines: wp.array2d[wp.uint8],
    words: wp.array[int],
    counts: wp.array[int],
): ...


@_native.func_native(FILE)
def list_rows(
    start: int,
    stop: int,
    images: wp.array2d[wp.int64],
    words: wp.array[int],
    ends: wp.array[int],
    cells: wp.array2d[int],
    responses: wp.array[wp.int64],
): ...


@_native.each(FILE)
def round_row(
    row: int,
    src: wp.array2d[float],
    # outputs
    dst: wp.array2d[wp.uint8],
): ...


@wp.kernel
def shrink(
    slab: int,
    first: int,
    last: int,
    images: wp.array2d[wp.int64],  # (O, 4)
    starts: wp.array[int],
    weights: wp.array2d[wp.uint8],
    # scratch
    shared: wp.array[int],  # (1 + groups of 32 rows of the smaller sizes,), cleared
):
    make_sizes(images, starts, weights, shared)


@wp.kernel
def mark(
    slab: int,
    first: int,
    last: int,
    images: wp.array2d[wp.int64],  # (O, 4)
    threshold: int,
    margin: int,
    # scratch
    lines: wp.array2d[wp.uint8],  # (3 slabs, W and 64 on both sides)
    # outputs
    words: wp.array[int],
    counts: wp.array[int],
):
    mark_rows(slab, first, last, images, threshold, margin, lines, words, counts)


@wp.kernel
def gather(
    slab: int,
    first: int,
    last: int,
    images: wp.array2d[wp.int64],  # (O, 4)
    words: wp.array[int],
    ends: wp.array[int],
    # outputs
    cells: wp.array2d[int],  # (N, 4)
    responses: wp.array[wp.int64],
):
    list_rows(first, last, images, words, ends, cells, responses)


@_native.each(FILE, **DESCRIBE)
def describe_one(
    k: int,
    images: wp.array2d[wp.int64],  # (O, 4)
    cells: wp.array2d[int],  # (N, 4)
    pattern: wp.array3d[wp.int16],  # (TURNS, PAIRS, 2)
    upright: int,
    # outputs
    angles: wp.array[float],
    descriptors: wp.array2d[wp.uint8],
): ...
