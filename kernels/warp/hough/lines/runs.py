"""Points along lines, cut into runs at gaps, in Warp."""

import warp as wp

from cvkern.kernels.codes.hough import DENSITY, PARTIAL
from cvkern.kernels.warp._launch import current_stream, launch, launch_each, launch_slabs, scratch
from cvkern.kernels.warp._sums import scan

from . import _runs as each
from . import _runs_cpu as cpu


def prepare(
    points: wp.array, directions: wp.array, parts: float, fixed: wp.array, codes: wp.array
) -> None:
    """Round points to fixed point, and directions to their codes."""
    _launch(each.prepare, points, [points, directions, parts], [fixed, codes])


def cut(
    points: wp.array,
    codes: wp.array,
    labels: wp.array,
    lines: wp.array,
    normals: wp.array,
    limits: tuple[float, float],
    order: wp.array,
    runs: wp.array,
    chosen: wp.array,
    total: wp.array,
) -> None:
    """Sort points along their lines, cut them at gaps, and list the long and dense runs.

    `lines` are cosines and sines, (2, K), and `limits` the largest gap and the least length. Points
    of both sides of a line are apart. `order` has 2 N elements: the sort needs the second half.
    """
    max_gap, least = limits
    number, none, device = points.shape[0], 2 * lines.shape[1], points.device
    along = scratch("runs.along", (number,), wp.float64, device)
    if not device.is_cuda:
        sorting = cpu.Sorting()
        sorting.order, sorting.runs, sorting.along = order, runs, along
        sorting.groups = scratch("runs.groups", (number,), wp.int32, device)
        sorting.pairs = scratch("runs.pairs", (2 * number,), wp.uint64, device)
        sorting.counts = scratch("runs.counts", (max(1 << cpu.DIGIT, none),), wp.int32, device)
        given = [points, codes, labels, lines, normals, wp.vec3d(max_gap, least, DENSITY), sorting]
        launch_slabs(cpu.cut, 1, 1, given, [chosen, total])
        return
    keys = scratch("runs.keys", (2 * number,), wp.int64, device)
    placed = scratch("runs.sorted", (number,), wp.float64, device)
    ranks = scratch("runs.ranks", (number,), wp.int32, device)
    places = scratch("runs.places", (number,), wp.int32, device)
    begins = scratch("runs.begins", (number + 1,), wp.int32, device)
    _launch(each.place, points, [points, codes, labels, lines, normals], [keys, order, along])
    _sort(keys, order, number, 32 + none.bit_length())
    _launch(each.gather, points, [keys, order, along, none, max_gap], [placed, ranks])
    scan(ranks)
    _launch(each.begin_runs, points, [ranks], [begins])
    inputs = [keys, placed, ranks, begins, none, least, DENSITY]
    _launch(each.choose, points, inputs, [places])
    scan(places)
    _launch(each.mark, points, [order, ranks, begins, places], [runs, chosen, total])


def add_up(
    points: wp.array, directions: wp.array, order: wp.array, runs: wp.array, sums: wp.array
) -> None:
    """Add up rows and columns, their squares and products, from the first point of each run.

    Before these sums, `sums` (S, 8) has row, column and direction of the first point.
    """
    number = sums.shape[0]
    inputs = [points, directions, order, runs]
    if not sums.device.is_cuda:
        launch_each(cpu.add_up, number, points.size, inputs, [sums])
        return
    partial = scratch("runs.partial", (number, PARTIAL, each.SUMS), wp.float64, sums.device)
    launch_each(each.add_up, number * PARTIAL, points.size, [points, order, runs], [partial])
    launch_each(each.finish, number * each.SUMS, partial.size, inputs, [partial, sums])


def reach(
    points: wp.array, order: wp.array, runs: wp.array, lines: wp.array, ends: wp.array
) -> None:
    """Find the least and the largest place of each run along its line."""
    number = ends.shape[0]
    inputs = [points, order, runs, lines]
    if not ends.device.is_cuda:
        launch_each(cpu.reach, number, points.size, inputs, [ends])
        return
    partial = scratch("runs.partial", (number, PARTIAL, 2), wp.float64, ends.device)
    launch_each(each.reach, number * PARTIAL, points.size, inputs, [partial])
    launch_each(each.join, number, partial.size, [partial], [ends])


def hold(labels: wp.array, chosen: wp.array, after: wp.array) -> None:
    """Return the label that a point has to come after: a point of a run keeps its line."""
    _launch(each.hold, labels, [labels, chosen], [after])


def keep(
    points: wp.array,
    directions: wp.array,
    chosen: wp.array,
    left_points: wp.array,
    left_directions: wp.array,
    total: wp.array,
) -> None:
    """List the points that are in no run, in their order."""
    outputs = [left_points, left_directions, total]
    if not chosen.device.is_cuda:
        launch(cpu.keep, 1, [points, directions, chosen], outputs)
        return
    places = scratch("runs.places", (chosen.shape[0],), wp.int32, chosen.device)
    _launch(each.count_left, points, [chosen], [places])
    scan(places)
    _launch(each.keep, points, [points, directions, places], outputs)


def _launch(kernel: wp.Kernel, items: wp.array, inputs: list, outputs: list) -> None:
    launch_each(kernel, items.shape[0], items.shape[0], inputs, outputs)


def _sort(keys: wp.array, order: wp.array, number: int, bits: int) -> None:
    """Sort by the lower bits of keys on CUDA; equal keys stay in their order.

    Arrays have room for twice the number.
    """
    with wp.ScopedStream(current_stream(keys.device), sync_enter=False):
        wp.utils.radix_sort_pairs(keys, order, number, end_bit=bits)
