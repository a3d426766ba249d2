"""Semi-global aggregation of matching costs, and the winner among them, in Warp."""

import warp as wp

from ..codes import LARGEST_MATCH_COST
from . import _match_blocks as match_blocks
from . import _match_costs_blocks as match_costs_blocks
from . import _match_rows as match_rows
from . import _paths_rows as path_rows
from . import _semi_global_blocks as cuda
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
        cuda.aggregate(costs, guide, p1, p2, p2_max, paths, top, sums)
        return
    height, width, depth = costs.shape
    count = slabs(height, costs.size)
    lines = _lines(count, depth, path_rows.WORD, sums.device)
    for n, (some, step) in enumerate(path_rows.sweeps(paths)):
        state = _begin(some, height, width, depth, path_rows.WORD, sums.device)
        launch_slabs(
            rows.sweep(costs.dtype, some),
            count,
            count,
            [costs, guide, p1, p2, step, n > 0, top, *lines, *state],
            [sums],
        )


def match_costs(
    left_bits: wp.array,
    right_bits: wp.array,
    left: wp.array,
    right: wp.array,
    first: int,
    costs: wp.array,
) -> None:
    """Compare each pixel of the left image with those of the right: census and grey value."""
    if costs.device.is_cuda:
        match_costs_blocks.match_costs(
            left_bits, right_bits, left, right, first, costs.shape[2], costs
        )
        return
    height, _, depth = costs.shape
    count = slabs(height, costs.size)
    unfolded = _unfold(right_bits, right, first, depth, count)
    given = [left_bits, left, unfolded]
    launch_slabs(match_rows.match_costs, height, count, given, [costs])


def match(
    left_bits: wp.array,
    right_bits: wp.array,
    left: wp.array,
    right: wp.array,
    first: int,
    count: int,
    p1: int,
    p2: wp.array,
    p2_max: int,
    paths: int,
    subpixel: int,
    uniqueness: int,
    top: int,
    index: wp.array,
    disparity: wp.array,
    cost: wp.array,
    confidence: wp.array,
    right_index: wp.array,
) -> None:
    """Do `match_costs`, `aggregate` along the left image, `pick` and `pick_right` in one."""
    if index.device.is_cuda:
        match_blocks.match(
            left_bits, right_bits, left, right, first, count, p1, p2, p2_max, paths, subpixel,
            uniqueness, top, index, disparity, cost, confidence, right_index,
        )  # fmt: skip
        return
    height, width = left.shape
    kept, padded, device = index.shape[0], _padded(count), index.device
    parts = slabs(height, height * width * count)
    unfolded = _unfold(right_bits, right, first, count, parts)
    sums = scratch("semi_global.sums", (kept, width, padded), wp.uint16, device)
    right_row = (kept, width + 2 * padded)
    best = scratch("winner.best", right_row, wp.uint16, device)
    place = scratch("winner.place", right_row, wp.uint16, device)
    launch_slabs(match_rows.clear_right, kept, parts, [index], [best, place])
    number = path_rows.BYTE if LARGEST_MATCH_COST + p2_max < 256 else path_rows.WORD
    lines = _lines(parts, count, number, device)
    sweeps = path_rows.sweeps(paths)
    for n, (some, step) in enumerate(sweeps):
        last = n == len(sweeps) - 1
        options = [first, count, p1, p2, step, n > 0, last, subpixel, uniqueness, top]
        state = _begin(some, height, width, count, number, device)
        launch_slabs(
            match_rows.sweep(some, number),
            parts,
            parts,
            [left_bits, left, unfolded, *options, *lines, *state, sums, best, place],
            [index, disparity, cost, confidence],
        )
    launch_slabs(match_rows.read_right, kept, parts, [count, best, place], [right_index])


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
        winner_blocks.pick(*options, *outputs)
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
        winner_blocks.pick_right(costs, first, index)
        return
    count = slabs(height, costs.size)
    kind, padded = winner_rows.kinds[costs.dtype], _padded(depth)
    row = (count, width + 2 * padded)
    lines = scratch("winner.line", (count, padded), kind.scalar, index.device)
    best = scratch("winner.best", row, kind.scalar, index.device)
    place = scratch("winner.place", row, kind.index, index.device)
    kernel = winner_rows.picks_right[costs.dtype]
    launch_slabs(kernel, height, count, [costs, first, lines, best, place], [index])


def _padded(depth: int) -> int:
    return -(-depth // path_rows.PADDED) * path_rows.PADDED


def _lines(
    count: int, depth: int, number: path_rows.Number, device: wp.Device
) -> tuple[wp.array, wp.array]:
    """Return the costs and the sums of the pixels that each slab is at."""
    shape = (count, path_rows.BLOCK * _padded(depth))
    return (
        scratch("semi_global.costs", shape, number.scalar, device),
        scratch("semi_global.totals", shape, wp.uint16, device),
    )


def _begin(
    paths: path_rows.Paths,
    height: int,
    width: int,
    depth: int,
    number: path_rows.Number,
    device: wp.Device,
) -> tuple[wp.array, int, int, wp.array]:
    """Return what a sweep starts with: the slots of its chains, its grid of tasks, its tasks."""
    strips = -(-height // path_rows.STRIP)
    blocks = -(-(width + path_rows.skew(paths) * (height - 1)) // path_rows.BLOCK)
    # Behind the last slot, the header of one more: what is next to the last disparity.
    shape = (path_rows.chains(paths, height, width) + 1, number.header + _padded(depth))
    slots = scratch("semi_global.slots", shape, number.scalar, device)
    tasks = scratch("semi_global.tasks", (STATE + 2 * strips * blocks,), wp.int32, device)
    launch(path_rows.prepare(number), 1, [strips, blocks], [slots, tasks])
    return slots, strips, blocks, tasks


def _unfold(bits: wp.array, gray: wp.array, first: int, depth: int, count: int) -> wp.array:
    """Lay out the right image for `match_rows`."""
    height, width = gray.shape
    shape = (match_rows.LINES * height, width + _padded(depth))
    unfolded = scratch("match.unfolded", shape, wp.uint8, gray.device)
    launch_slabs(match_rows.unfold, height, count, [bits, gray, first], [unfolded])
    return unfolded
