"""The line that a point belongs to, in Warp: a thread takes a slab of points (CPU), or a point."""

import warp as wp

from cvkern.kernels.warp._launch import BLOCK, launch, launch_slabs, scratch, slabs
from cvkern.kernels.warp._zeros import clear

from . import _segments_cpu as cpu
from . import _segments_cuda as cuda


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
    device = points.device
    # Slabs are shares of the points; smaller ones balance the threads.
    count = slabs(number, number * lines.shape[1] // 16)  # 16 points at a time
    count = min(2 * count, number) if count > 1 else 1
    tiles = cpu.Tiles()
    tiles.order = scratch("claim.order", (number,), wp.int32, device)
    room = (cpu.MOST_TILES + 1) ** 2 * cpu.SECTORS + 2
    tiles.starts = scratch("claim.starts", (room,), wp.int32, device)
    tiles.frame = scratch("claim.frame", (3,), wp.int32, device)
    tiles.places = scratch("claim.places", (number,), wp.int32, device)
    lists = count, cpu.SECTORS, lines.shape[1]
    tiles.near = scratch("claim.near", lists, wp.int32, device)
    launch_slabs(cpu.sort_points, 1, 1, [*inputs, tiles], [labels])
    launch_slabs(cpu.claim, number, count, [*inputs, tiles], [labels])
