"""Semi-global aggregation of matching costs, and the winner among them, in Warp."""

import warp as wp

from . import _semi_global_blocks as blocks
from . import _semi_global_rows as rows
from . import _winner_blocks as winner_blocks
from . import _winner_rows as winner_rows
from ._launch import launch, launch_slabs, scratch, slabs
from ._wavefront import STATE


def aggregate(
    costs: wp.array,
    guide: wp.array,
    p1: int,
    p2: wp.array,
    p2_max: int,
    paths: int,
    top: int,
    sums: wp.array,
) -> None:
    """Sum the costs of the best ways to each pixel and disparity, for the rows from `top` on."""
    if sums.device.is_cuda:
        blocks.aggregate(costs, guide, p1, p2, p2_max, paths, top, sums)
        return
    first = rows.STRAIGHT if paths == 4 else rows.STRAIGHT + rows.DIAGONAL
    for some in (first,) if paths < 16 else (first, rows.KNIGHT):
        for step in (1, -1):
            _sweep(costs, guide, p1, p2, some, step, some is rows.KNIGHT or step < 0, top, sums)


def largest(costs: wp.array, most: wp.array) -> None:
    """Find the largest cost of each pixel."""
    if most.device.is_cuda:
        launch(winner_blocks.largest, most.shape, [costs], [most])
        return
    height = most.shape[0]
    launch_slabs(winner_rows.largest, height, slabs(height, costs.size), [costs], [most])


def pick(
    costs: wp.array,
    first: int,
    subpixel: int,
    uniqueness: int,
    index: wp.array,
    disparity: wp.array,
    cost: wp.array,
    confidence: wp.array,
) -> None:
    """Find the least cost of each pixel, the disparity between the pixels, and how sure it is."""
    options, outputs = [costs, first, subpixel, uniqueness], [index, disparity, cost, confidence]
    if index.device.is_cuda:
        launch(winner_blocks.pick(costs.dtype), -(-index.size // 8) * 256, options, outputs)
        return
    height, _, depth = costs.shape
    count = slabs(height, costs.size)
    kind = winner_rows.kinds[costs.dtype]
    lines = scratch("winner.line", (count, _padded(depth)), kind.scalar, index.device)
    launch_slabs(winner_rows.picks[costs.dtype], height, count, [*options, lines], outputs)


def pick_right(costs: wp.array, first: int, index: wp.array) -> None:
    """Find the least cost of each pixel of the right image, on the diagonals of the volume."""
    height, width, depth = costs.shape
    if index.device.is_cuda:
        dim = height * -(-width // 256) * 256
        launch(winner_blocks.pick_right(costs.dtype), dim, [costs, first], [index])
        return
    count = slabs(height, costs.size)
    kind, padded = winner_rows.kinds[costs.dtype], _padded(depth)
    row = (count, width + 2 * padded)
    lines = scratch("winner.line", (count, padded), kind.scalar, index.device)
    best = scratch("winner.best", row, kind.scalar, index.device)
    place = scratch("winner.place", row, kind.index, index.device)
    kernel = winner_rows.picks_right[costs.dtype]
    launch_slabs(kernel, height, count, [costs, first, lines, best, place], [index])


def _sweep(
    costs: wp.array,
    guide: wp.array,
    p1: int,
    p2: wp.array,
    paths: tuple[tuple[int, int], ...],
    step: int,
    add: bool,
    top: int,
    sums: wp.array,
) -> None:
    height, columns, depth = costs.shape
    count = slabs(height, costs.size)
    padded = _padded(depth)
    tasks_wide = -(-(columns + rows.skew(paths) * (height - 1)) // rows.BLOCK)
    chains = sum(down * (columns - 1) + abs(along) * (height - 1) + 1 for down, along in paths)
    numbers = chains * (rows.HEADER + padded) + rows.HEADER
    slots = scratch("semi_global.slots", (numbers,), wp.uint16, sums.device)
    strips = -(-height // rows.STRIP)
    tasks = scratch("semi_global.tasks", (STATE + 2 * strips * tasks_wide,), wp.int32, sums.device)
    lines = (count, rows.BLOCK * padded)
    values = scratch("semi_global.costs", lines, wp.uint16, sums.device)
    totals = scratch("semi_global.totals", lines, wp.uint16, sums.device)
    launch(rows.prepare, 1, [padded, strips, tasks_wide], [slots, tasks])
    launch_slabs(
        rows.sweeps[costs.dtype, paths],
        count,
        count,
        [costs, guide, p1, p2, step, add, top, values, totals, slots, strips, tasks_wide, tasks],
        [sums],
    )


def _padded(depth: int) -> int:
    return -(-depth // rows.PADDED) * rows.PADDED
