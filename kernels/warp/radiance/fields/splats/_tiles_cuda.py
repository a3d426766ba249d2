"""Splats composited on CUDA: a block takes a tile, a thread a pixel.

The gradients of a splat are added over the pixels of a warp in registers, each lane keeping fewer
of the sums at each of five steps: 12 exchanges of lanes instead of 45.
"""

import warp as wp

from cvkern.kernels.codes import splats as codes
from cvkern.kernels.warp import _native
from cvkern.kernels.warp.radiance._structs import Seen

from ._structs import Tiles

wp.set_module_options({"enable_backward": False})

BATCH = 32  # splats whose gradients a block keeps at a time
AREA = wp.constant(codes.TILE * codes.TILE)
_RULES = {
    "TILE": codes.TILE,
    "SHOWN": codes.SHOWN,
    "FAINT": f"{codes.FAINT:.9g}f",
    "MOST": f"{codes.MOST:.9g}f",
    "Tiles": Tiles.native_name,
    "Seen": Seen.native_name,
}


@_native.func_native("_tiles_cuda.cu", **_RULES)
def composite_pixel(
    tile: int,
    tiles: Tiles,
    seen: Seen,
): ...


@_native.func_native("_tiles_cuda.cu", SLOPES=codes.SLOPES, BATCH=BATCH, **_RULES)
def trace_pixel(
    tile: int,
    d_seen: Seen,
    tiles: Tiles,
    seen: Seen,
    slopes: wp.array2d[float],
): ...


@wp.kernel
def composite(
    tiles: Tiles,
    # outputs
    seen: Seen,
):
    """Composite a pixel."""
    composite_pixel(wp.tid() // AREA, tiles, seen)


@wp.kernel
def trace(
    d_seen: Seen,
    tiles: Tiles,
    seen: Seen,
    # outputs
    slopes: wp.array2d[float],  # (E, 9)
):
    """Compute a pixel's share of gradients."""
    trace_pixel(wp.tid() // AREA, d_seen, tiles, seen, slopes)
