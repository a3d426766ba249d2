"""FAST corners on the CPU, row by row."""

import warp as wp

from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

FILE = "_binary_cpu.h"


@_native.func_native(FILE)
def score_row(
    row: int,
    src: wp.array2d[wp.uint8],
    threshold: int,
    margin: int,
    scores: wp.array2d[wp.uint8],
): ...


@_native.func_native(FILE)
def mark_row(row: int, scores: wp.array2d[wp.uint8], words: wp.array3d[int]): ...


@_native.func_native(FILE)
def round_row(row: int, src: wp.array2d[float], dst: wp.array2d[wp.uint8]): ...


@_native.func_native(FILE)
def widen_row(row: int, src: wp.array2d[wp.uint8], dst: wp.array2d[float]): ...


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
def widen_values(
    slab: int,
    first: int,
    last: int,
    src: wp.array2d[wp.uint8],
    # outputs
    dst: wp.array2d[float],
):
    for row in range(first, last):
        widen_row(row, src, dst)


@wp.kernel
def score(
    slab: int,
    first: int,
    last: int,
    src: wp.array2d[wp.uint8],
    threshold: int,
    margin: int,
    # outputs
    scores: wp.array2d[wp.uint8],
):
    for row in range(first, last):
        score_row(row, src, threshold, margin, scores)


@wp.kernel
def mark(
    slab: int,
    first: int,
    last: int,
    scores: wp.array2d[wp.uint8],
    # outputs
    words: wp.array3d[int],
):
    for row in range(first, last):
        mark_row(row, scores, words)
