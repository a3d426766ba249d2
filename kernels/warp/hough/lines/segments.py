"""The line that a point belongs to, in Warp: a thread takes a slab of points (CPU), or a point."""

import math

import numpy as np
import warp as wp

from cvkern.kernels.warp._launch import BLOCK, launch, launch_slabs, scratch, slabs
from cvkern.kernels.warp._zeros import clear

from . import _segments_cpu as cpu
from . import _segments_cuda as cuda

_SIDE = 32  # pixels: smallest side of a tile
_MOST_TILES = 40  # tiles along the longer side of an image


def claim(
    points: wp.array,
    codes: wp.array,
    after: wp.array,
    lines: wp.array,
    directions: wp.array,
    distance: float,
    tolerance: int,
    labels: wp.array,
) -> None:
    """Label every point with the first line after `after` that it is on, or the number of lines.

    `lines` has rows of cosines, sines and distances, (3, K).
    """
    number = points.shape[0]
    inputs = [points, codes, after, lines, directions, distance, tolerance]
    if points.device.is_cuda:
        device, tiles = points.device, cuda.TILES**2
        extent = scratch("claim.extent", (1,), wp.int32, device)
        near = scratch("claim.near", (tiles, lines.shape[1]), wp.int32, device)
        counts = scratch("claim.counts", (tiles,), wp.int32, device)
        clear(extent)
        launch(cuda.find_extent, number, [points], [extent])
        launch(cuda.find_near, tiles * BLOCK, [lines, distance, extent], [near, counts])
        launch(cuda.claim, number, [*inputs, extent, near, counts], [labels])
        return
    tiles = _tiles_of(points)
    rows = tiles.starts.shape[0] - 1
    count = slabs(rows, number * lines.shape[1])
    if count > 1:  # edges cluster in parts of an image; smaller slabs balance the threads
        count = min(4 * count, rows)
    tiles.near = scratch("claim.near", (count, lines.shape[1] + 1), wp.int32, points.device)
    launch_slabs(cpu.claim, rows, count, [*inputs, tiles], [labels])


def _tiles_of(points: wp.array) -> cpu.Tiles:
    """Sort points into tiles."""
    place = points.numpy()
    side = max(_SIDE, math.ceil(place.max() / _MOST_TILES))
    # Conversion to integers rounds towards 0, so points just outside belong to the first tiles.
    at = (place * np.float32(1 / side)).astype(np.uint16)
    across = int(at[:, 1].max()) + 1
    tile = at[:, 0] * np.uint16(across) + at[:, 1]
    starts = np.concatenate(([0], np.cumsum(np.bincount(tile)))).astype(np.int32)
    tiles = cpu.Tiles()
    tiles.side, tiles.across = float(side), across
    # NumPy sorts 16-bit numbers by their digits.
    order = np.argsort(tile, kind="stable").astype(np.int32)
    tiles.order, tiles.starts = (
        wp.array(a, dtype=wp.int32, device=points.device, copy=False) for a in (order, starts)
    )
    return tiles
