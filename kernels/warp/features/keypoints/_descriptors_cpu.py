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


@_native.each(FILE, **ORIENT)
def orient_one(
    k: int,
    octaves: wp.array2d[wp.int64],
    windows: wp.array2d[int],
    spreads: wp.array[float],
    one: float,
    # outputs
    angles: wp.array2d[float],
    counts: wp.array[int],
): ...


@_native.each(FILE, **DESCRIBE)
def describe_one(
    k: int,
    octaves: wp.array2d[wp.int64],
    windows: wp.array2d[int],
    turns: wp.array2d[float],
    one: float,
    root: int,
    # outputs
    descriptors: wp.array2d[wp.uint8],
): ...
