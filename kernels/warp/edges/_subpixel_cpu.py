"""Sub-pixel edge points on the CPU: a thread takes a slab of rows."""

import warp as wp

from cvkern.kernels.warp import _native

from ._parabolas import locate, three_lengths

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@_native.func_native("_subpixel_cpu.h")
def list_peaks(
    y: int,
    dy: wp.array2d[float],
    dx: wp.array2d[float],
    mask: wp.array2d[wp.uint8],
    slab: int,
    # scratch
    flags: wp.array2d[wp.uint8],
    # outputs
    columns: wp.array2d[int],
) -> int: ...


@wp.kernel
def count_edges(
    slab: int,
    first: int,
    last: int,
    dy: wp.array2d[float],  # (H, W)
    dx: wp.array2d[float],  # (H, W)
    mask: wp.array2d[wp.uint8],  # (H, W)
    # scratch
    flags: wp.array2d[wp.uint8],  # (slabs, W)
    columns: wp.array2d[int],  # (slabs, W)
    # outputs
    counts: wp.array[int],  # (H,)
):
    for y in range(first, last):
        counts[y] = list_peaks(y, dy, dx, mask, slab, flags, columns)


@wp.kernel
def gather_edges(
    slab: int,
    first: int,
    last: int,
    dy: wp.array2d[float],  # (H, W)
    dx: wp.array2d[float],  # (H, W)
    mask: wp.array2d[wp.uint8],  # (H, W)
    starts: wp.array[int],  # (H,)
    # scratch
    flags: wp.array2d[wp.uint8],  # (slabs, W)
    columns: wp.array2d[int],  # (slabs, W)
    # outputs
    points: wp.array2d[float],  # (N, 2)
    orientation: wp.array[float],  # (N,)
    strength: wp.array[float],  # (N,)
):
    for y in range(first, last):
        count = list_peaks(y, dy, dx, mask, slab, flags, columns)
        for k in range(count):
            x = columns[slab, k]
            m = three_lengths(dy, dx, y, x)
            locate(dy, dx, y, x, m, starts[y] + k, points, orientation, strength)
