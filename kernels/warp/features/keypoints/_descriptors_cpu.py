"""Orientations and descriptors on the CPU, one point at a time.

The code (_descriptors_cpu.h) is native, because it computes gradients and angles of 16 pixels at
once.
"""

import warp as wp

from cvkern.kernels.codes import features as codes
from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

FILE = "_descriptors_cpu.h"
# Constants of the native code, on CUDA as well.
ORIENT = {
    "BINS": codes.BINS,
    "PEAKS": codes.PEAKS,
    "LONGEST": f"{codes.LONGEST}f",
    "BINS_PER_RADIAN": f"{codes.BINS_PER_RADIAN!r}f",
    "REACH": codes.REACH,
}
DESCRIBE = {
    "CELLS": codes.CELLS,
    "DIRECTIONS": codes.DIRECTIONS,
    "LONGEST": f"{codes.LONGEST}f",
    "DIRECTIONS_PER_RADIAN": f"{codes.DIRECTIONS_PER_RADIAN!r}f",
    "REACH": codes.REACH,
    "LARGEST_SHARE": codes.LARGEST_SHARE,
    "DESCRIPTOR_ONE": codes.DESCRIPTOR_ONE,
}


@_native.func_native(FILE, **ORIENT)
def orient_one(
    k: int,
    octaves: wp.array2d[wp.int64],
    windows: wp.array2d[int],
    spreads: wp.array[float],
    one: float,
    angles: wp.array2d[float],
    counts: wp.array[int],
): ...


@_native.func_native(FILE, **DESCRIBE)
def describe_one(
    k: int,
    octaves: wp.array2d[wp.int64],
    windows: wp.array2d[int],
    turns: wp.array2d[float],
    one: float,
    root: int,
    descriptors: wp.array2d[wp.uint8],
): ...


@wp.kernel
def orient(
    slab: int,
    first: int,
    last: int,
    octaves: wp.array2d[wp.int64],
    windows: wp.array2d[int],
    spreads: wp.array[float],
    one: float,
    # outputs
    angles: wp.array2d[float],
    counts: wp.array[int],
):
    for k in range(first, last):
        orient_one(k, octaves, windows, spreads, one, angles, counts)


@wp.kernel
def describe(
    slab: int,
    first: int,
    last: int,
    octaves: wp.array2d[wp.int64],
    windows: wp.array2d[int],
    turns: wp.array2d[float],
    one: float,
    root: int,
    # outputs
    descriptors: wp.array2d[wp.uint8],
):
    for k in range(first, last):
        describe_one(k, octaves, windows, turns, one, root, descriptors)
