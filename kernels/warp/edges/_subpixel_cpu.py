"""Sub-pixel edge points on the CPU: a thread takes a slab of rows."""

import warp as wp

from cvkern.kernels.codes.edges import LEAST_MANTISSA, LEAST_RATIO, LN2, LOG, MANTISSA_BITS
from cvkern.kernels.warp import _native

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


@_native.func_native(
    "_subpixel_cpu.h",
    **{f"LOG_{i}": LOG[i] for i in range(1, 5)},
    LN2=LN2,
    LEAST_MANTISSA=LEAST_MANTISSA,
    MANTISSA_BITS=MANTISSA_BITS,
    LEAST_RATIO=LEAST_RATIO,
)
def locate_row(
    y: int,
    dy: wp.array2d[float],
    dx: wp.array2d[float],
    slab: int,
    columns: wp.array2d[int],
    count: int,
    begin: int,
    # outputs
    points: wp.array2d[float],
    orientation: wp.array[float],
    strength: wp.array[float],
): ...


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
        locate_row(y, dy, dx, slab, columns, count, starts[y], points, orientation, strength)
