"""Speckles on the CPU: runs within rows, joined from row to row; one thread per slab of rows.

One thread joins the seams between the slabs afterwards. The code is native, because plain Warp
multiplies by an array's strides at each access, and its loops took several times as long.
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
