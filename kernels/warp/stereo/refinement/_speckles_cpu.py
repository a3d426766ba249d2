"""Speckles on the CPU: runs within the rows, joined from row to row; one thread a slab of rows.

The seams between the slabs are joined afterwards, by one thread. Native: the loops of plain Warp,
which multiplies by the strides of an array at each access, took several times as long.
"""

import warp as wp

from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@_native.kernel("_speckles_rows_cpu.h")
def label_slab(
    slab: int,
    first: int,
    last: int,
    disparity: wp.array2d[float],  # (H, W)
    difference: float,
    # outputs
    labels: wp.array[int],  # (H W,)
    parents: wp.array[int],  # (H W,)
    sizes: wp.array[int],  # (H W,)
): ...


@_native.kernel("_speckles_rows_cpu.h")
def join_slabs(
    slabs: int,
    disparity: wp.array2d[float],  # (H, W)
    difference: float,
    labels: wp.array[int],  # (H W,)
    # outputs
    parents: wp.array[int],  # (H W,)
    sizes: wp.array[int],  # (H W,)
): ...


@_native.kernel("_speckles_rows_cpu.h")
def keep_regions(
    slab: int,
    first: int,
    last: int,
    disparity: wp.array2d[float],  # (H, W)
    min_size: int,
    labels: wp.array[int],  # (H W,)
    parents: wp.array[int],  # (H W,)
    sizes: wp.array[int],  # (H W,)
    # outputs
    kept: wp.array2d[float],  # (H, W)
): ...
