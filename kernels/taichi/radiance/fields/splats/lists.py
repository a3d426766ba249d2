"""The splats of each tile, front to back, in Taichi; one thread per part of the splats.

Splats are sorted by the bits of their depth, which are ordered as positive numbers are, eight bits
at a time; splats of one depth stay in the order of their numbers. Each part of the splats counts
its digits, the counts are added up digit by digit and, within these, part by part, and each part
puts its splats where the sums say. The entries of the sorted splats are dealt to tiles in the same
way. So the parts have no effect on the result.
"""

from typing import Any

import numpy as np
import taichi as ti

from cvkern.kernels.codes import splats as codes
from cvkern.kernels.taichi._launch import on_cpu, primitive, scratch

i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)

BITS = 8  # bits of a digit
END = 0x7FFFFFFF  # the number of entries that more of them leave as it is


@ti.kernel
def _number(
    keys: i32_1,  # (N,)
    # outputs
    copy: i32_1,  # (N,)
    order: i32_1,  # (N,)
):
    for n in range(keys.shape[0]):
        copy[n] = keys[n]
        order[n] = n


@ti.func
def _bound(count: ti.i32, part: ti.i32, parts: ti.i32) -> ti.i32:
    """Return the first item of a part."""
    return ti.cast(ti.cast(count, ti.i64) * part // parts, ti.i32)


@ti.kernel
def _tally_digits(
    keys: i32_1,  # (N,)
    shift: ti.i32,
    # outputs
    starts: i32_2,  # (2^BITS, P)
):
    parts = starts.shape[1]
    for part in range(parts):
        for digit in range(1 << BITS):
            starts[digit, part] = 0
        for n in range(_bound(keys.shape[0], part, parts), _bound(keys.shape[0], part + 1, parts)):
            digit = (keys[n] >> shift) & ((1 << BITS) - 1)
            starts[digit, part] = starts[digit, part] + 1


@ti.kernel
def _start(
    # outputs
    starts: i32_2,  # (D, P): counts, replaced by the sums before them
    ranges: i32_1,  # (D + 1,)
):
    for _ in range(1):
        total = 0
        for digit in range(starts.shape[0]):
            ranges[digit] = total
            for part in range(starts.shape[1]):
                count = starts[digit, part]
                starts[digit, part] = total
                total += count
        ranges[starts.shape[0]] = total


@ti.kernel
def _deal_digits(
    keys: i32_1,  # (N,)
    order: i32_1,  # (N,)
    shift: ti.i32,
    # outputs
    starts: i32_2,  # (2^BITS, P)
    sorted_keys: i32_1,  # (N,)
    sorted_order: i32_1,  # (N,)
):
    parts = starts.shape[1]
    for part in range(parts):
        for n in range(_bound(keys.shape[0], part, parts), _bound(keys.shape[0], part + 1, parts)):
            digit = (keys[n] >> shift) & ((1 << BITS) - 1)
            place = starts[digit, part]
            starts[digit, part] = place + 1
            sorted_keys[place] = keys[n]
            sorted_order[place] = order[n]


@ti.func
def _sum(total: ti.i32, more: ti.i32) -> ti.i32:
    """Return a sum of entries, END at most, whatever the order of its terms."""
    return total + more if more < END - total else END


@ti.kernel
def _add_up(
    boxes: i32_2,  # (N, 4)
    order: i32_1,  # (N,)
    # outputs
    sums: i32_1,  # (P,)
):
    for part in range(sums.shape[0]):
        count, parts = order.shape[0], sums.shape[0]
        total = 0
        for rank in range(_bound(count, part, parts), _bound(count, part + 1, parts)):
            total = _sum(total, boxes[order[rank], 2] * boxes[order[rank], 3])
        sums[part] = total


@ti.kernel
def _end(
    boxes: i32_2,  # (N, 4)
    order: i32_1,  # (N,)
    sums: i32_1,  # (P,)
    # outputs
    ranks: i32_1,  # (N,)
    ends: i32_1,  # (N,)
):
    for part in range(sums.shape[0]):
        count, parts = order.shape[0], sums.shape[0]
        total = 0
        for before in range(part):
            total = _sum(total, sums[before])
        for rank in range(_bound(count, part, parts), _bound(count, part + 1, parts)):
            total = _sum(total, boxes[order[rank], 2] * boxes[order[rank], 3])
            ranks[order[rank]] = rank
            ends[rank] = total


def _parts(count: int) -> int:
    """Return the number of parts of so many splats."""
    return min(16 if on_cpu() else 1024, count)


@primitive
def sort(screen: codes.Screen, order: np.ndarray, ranks: np.ndarray, ends: np.ndarray) -> None:
    """Order splats by depth, and number their entries, as `Lists` has all three."""
    count = order.shape[0]
    parts = _parts(count)
    keys, others, places = (scratch((count,), np.int32) for _ in range(3))
    starts, ranges = scratch((1 << BITS, parts), np.int32), scratch(((1 << BITS) + 1,), np.int32)
    _number(screen.keys, keys, order)
    given: Any = keys, order
    found: Any = others, places
    for shift in range(0, 32, BITS):
        _tally_digits(given[0], shift, starts)
        _start(starts, ranges)
        _deal_digits(*given, shift, starts, *found)
        given, found = found, given
    sums = scratch((parts,), np.int32)
    _add_up(screen.boxes, order, sums)
    _end(screen.boxes, order, sums, ranks, ends)


@ti.func
def _begin_of(ends: ti.template(), rank: ti.i32) -> ti.i32:
    """Return the first entry of a splat."""
    begin = 0
    if rank > 0:
        begin = ends[rank - 1]
    return begin


@ti.func
def _tile_of(boxes: ti.template(), n: ti.i32, at: ti.i32, columns: ti.i32) -> ti.i32:
    """Return the tile of an entry of a splat."""
    across = boxes[n, 2]
    return (boxes[n, 1] + at // across) * columns + boxes[n, 0] + at % across


@ti.kernel
def _tally(
    boxes: i32_2,  # (N, 4)
    columns: ti.i32,
    order: i32_1,  # (N,)
    ends: i32_1,  # (N,)
    room: ti.i32,
    # outputs
    starts: i32_2,  # (T, P)
):
    parts = starts.shape[1]
    for part in range(parts):
        for tile in range(starts.shape[0]):
            starts[tile, part] = 0
        count = order.shape[0]
        for rank in range(_bound(count, part, parts), _bound(count, part + 1, parts)):
            n = order[rank]
            entry = _begin_of(ends, rank)
            for at in range(ti.min(ends[rank], room) - entry):
                tile = _tile_of(boxes, n, at, columns)
                starts[tile, part] = starts[tile, part] + 1


@ti.kernel
def _deal(
    boxes: i32_2,  # (N, 4)
    columns: ti.i32,
    order: i32_1,  # (N,)
    ends: i32_1,  # (N,)
    # outputs
    starts: i32_2,  # (T, P)
    entries: i32_1,  # (E,)
    sources: i32_1,  # (E,)
):
    parts = starts.shape[1]
    for part in range(parts):
        count, room = order.shape[0], entries.shape[0]
        for rank in range(_bound(count, part, parts), _bound(count, part + 1, parts)):
            n = order[rank]
            entry = _begin_of(ends, rank)
            for at in range(ti.min(ends[rank], room) - entry):
                tile = _tile_of(boxes, n, at, columns)
                place = starts[tile, part]
                starts[tile, part] = place + 1
                entries[place] = n
                sources[place] = entry + at


@primitive
def fill(screen: codes.Screen, columns: int, lists: codes.Lists) -> None:
    """List the entries of each tile, front to back; a row of the screen has `columns` tiles.

    `order` and `ends` are those of :func:`sort`; the rest of `lists` is filled.
    """
    tiles, parts = lists.ranges.shape[0] - 1, _parts(lists.order.shape[0])
    starts = scratch((tiles, parts), np.int32)
    given = screen.boxes, columns, lists.order, lists.ends
    _tally(*given, lists.entries.shape[0], starts)
    _start(starts, lists.ranges)
    _deal(*given, starts, lists.entries, lists.sources)
