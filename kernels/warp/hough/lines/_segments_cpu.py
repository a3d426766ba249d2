"""The line that a point belongs to, on the CPU: one thread per slab of the points of some tiles.

A point (y, x) is on a line if ``|x cos + y sin - rho|`` is at most a distance and its direction is
within a tolerance of the line's.
"""

import warp as wp

from cvkern.kernels.codes.hough import DIRECTIONS
from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

SIDE = 64  # pixels: smallest side of a tile
MOST_TILES = 40  # tiles along the longer side of an image
LINES = 32  # lines at a time
POINTS = 256  # points at a time
SECTORS = 8  # parts of half a turn; a point needs only the lines that are listed for its own


@wp.struct
class Tiles:
    """The points by tiles, which are squares in raster order, and room for lists of lines."""

    order: wp.array[int]  # (N,): points, tile by tile
    starts: wp.array[int]  # where the points of each sector of a tile begin in `order`
    frame: wp.array[int]  # (3,): side, tiles in a row, number of tiles
    places: wp.array[int]  # (N,): tile and sector of each point
    near: wp.array3d[int]  # (slabs, SECTORS, K)


@_native.kernel(
    "_segments_cpu.h", MOST_TILES=MOST_TILES, SIDE=SIDE, SECTORS=SECTORS, HALF_TURN=DIRECTIONS // 2
)
def sort_points(
    slab: int,
    first: int,
    last: int,
    points: wp.array2d[float],  # (N, 2)
    codes: wp.array[int],  # (N,)
    after: wp.array[int],  # (N,)
    lines: wp.array2d[float],  # (3, K): cosine, sine, rho
    directions: wp.array[int],  # (K,)
    distance: float,
    tolerance: int,
    tiles: Tiles,
    # outputs
    labels: wp.array[int],  # (N,)
): ...


@_native.kernel(
    "_segments_cpu.h", LINES=LINES, POINTS=POINTS, SECTORS=SECTORS, HALF_TURN=DIRECTIONS // 2
)
def claim(
    slab: int,
    first: int,
    last: int,
    points: wp.array2d[float],  # (N, 2)
    codes: wp.array[int],  # (N,)
    after: wp.array[int],  # (N,)
    lines: wp.array2d[float],  # (3, K): cosine, sine, rho
    directions: wp.array[int],  # (K,)
    distance: float,
    tolerance: int,
    tiles: Tiles,
    # outputs
    labels: wp.array[int],  # (N,)
): ...
