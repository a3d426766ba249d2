"""From edge points to circles on the CPU: one thread per slab of rows, points, centres or circles.

Each edge point has a line along its gradient; detection.py describes the steps. The points near a
centre are found 64 at a time, as vector code. Each slab of points has its own accumulator of
centres, and the accumulators are added.
"""

from typing import Any

import warp as wp

from cvkern.kernels.codes.hough import ARCS, FINE_ONE, LINE_ONE, NORMAL_ONE
from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Sight:
    """The condition for a point to support a centre; see `codes.hough.Aim`."""

    slack: float
    slope: float
    first_side: int
    last_side: int


def _shrink(scalar: Any) -> wp.Kernel:
    """Return the kernel for values of one type."""

    @_native.kernel("_centers_cpu.h", SCALAR=scalar)
    def shrink(
        slab: int,
        first: int,
        last: int,
        src: wp.array2d[scalar],  # (H, W)
        factor: int,
        # scratch
        lines: wp.array2d[float],  # (slabs, W)
        # outputs
        dst: wp.array2d[float],  # (H // factor, W // factor)
    ): ...

    return shrink


shrinks = {scalar: _shrink(scalar) for scalar in (wp.uint8, wp.float32)}


@_native.kernel("_centers_cpu.h", LINE_ONE=LINE_ONE, LINE_BITS=LINE_ONE.bit_length() - 1)
def vote_centers(
    slab: int,
    first: int,
    last: int,
    lines: wp.array2d[float],  # (4, N)
    low: int,
    high: int,
    scale: float,
    first_side: int,
    last_side: int,
    # outputs
    votes: wp.array3d[int],  # (slabs, H, W)
): ...


@_native.kernel("_centers_cpu.h")
def add_parts(
    parts: wp.array3d[int],  # (slabs, H, W)
    # outputs
    votes: wp.array2d[float],  # (H, W)
): ...


@_native.kernel("_circles_cpu.h")
def vote_radii(
    slab: int,
    first: int,
    last: int,
    lines: wp.array2d[float],  # (4, N)
    centers: wp.array2d[float],  # (K, 2)
    least: float,
    most: float,
    per_bin: float,
    sight: Sight,
    # outputs
    histograms: wp.array2d[int],  # (K, bins)
): ...


@_native.kernel("_circles_cpu.h", ARCS=ARCS, NORMAL_ONE=NORMAL_ONE, FINE_ONE=FINE_ONE)
def support(
    slab: int,
    first: int,
    last: int,
    lines: wp.array2d[float],  # (4, N)
    circles: wp.array2d[float],  # (K, 3)
    band: float,
    sight: Sight,
    # outputs
    sums: wp.array2d[wp.int64],  # (K, 9)
    arcs: wp.array2d[int],  # (K, ARCS)
): ...
