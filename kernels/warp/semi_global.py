"""Semi-global aggregation of matching costs, and the winner among them, in Warp."""

import warp as wp

from . import _semi_global_rows as rows
from ._launch import launch, launch_slabs, scratch, slabs
from ._wavefront import STATE


def aggregate(
    costs: wp.array, guide: wp.array, p1: int, p2: wp.array, paths: int, sums: wp.array
) -> None:
    """Sum the costs of the best ways to each pixel and disparity along the paths."""
    first = rows.STRAIGHT if paths == 4 else rows.STRAIGHT + rows.DIAGONAL
    for some in (first,) if paths < 16 else (first, rows.KNIGHT):
        for step in (1, -1):
            _sweep(costs, guide, p1, p2, some, step, some is rows.KNIGHT or step < 0, sums)


def _sweep(
    costs: wp.array,
    guide: wp.array,
    p1: int,
    p2: wp.array,
    paths: tuple[tuple[int, int], ...],
    step: int,
    add: bool,
    sums: wp.array,
) -> None:
    height, columns, depth = costs.shape
    count = slabs(height, costs.size)
    padded = -(-depth // rows.PADDED) * rows.PADDED
    blocks = -(-(columns + rows.skew(paths) * (height - 1)) // rows.BLOCK)
    chains = sum(down * (columns - 1) + abs(along) * (height - 1) + 1 for down, along in paths)
    numbers = chains * (rows.HEADER + padded) + rows.HEADER
    slots = scratch("semi_global.slots", (numbers,), wp.uint16, sums.device)
    strips = -(-height // rows.STRIP)
    tasks = scratch("semi_global.tasks", (STATE + 2 * strips * blocks,), wp.int32, sums.device)
    lines = (count, rows.BLOCK * padded)
    values = scratch("semi_global.costs", lines, wp.uint16, sums.device)
    totals = scratch("semi_global.totals", lines, wp.uint16, sums.device)
    launch(rows.prepare, 1, [padded, strips, blocks], [slots, tasks])
    launch_slabs(
        rows.sweeps[costs.dtype, paths],
        count,
        count,
        [costs, guide, p1, p2, step, add, values, totals, slots, strips, blocks, tasks],
        [sums],
    )
