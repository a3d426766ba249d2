"""The splats of each tile, front to back, in Warp; the Taichi set has the rules.

On the CPU, parts of the splats are counted and dealt to tiles at the same time. On CUDA the entries
of all splats are written in order and sorted by tile; the sort keeps those of a tile in order.
"""

import warp as wp

from cvkern.kernels.codes import splats as codes
from cvkern.kernels.warp._launch import launch, launch_each, scratch
from cvkern.kernels.warp._streams import current_stream
from cvkern.kernels.warp._structs import struct_of
from cvkern.kernels.warp._sums import scan

from ._structs import Lists

wp.set_module_options({"enable_backward": False})

END = wp.constant(2**31 - 1)
PARTS = wp.constant(16)  # parts of the splats that are dealt at the same time on the CPU


@wp.kernel
def number_kernel(
    stride: int,
    first: int,
    last: int,
    keys: wp.array[int],  # (N,)
    # outputs
    copy: wp.array[int],  # (2 N,)
    order: wp.array[int],  # (2 N,)
):
    """Copy and number a key."""
    for n in range(first + wp.tid(), last, stride):
        copy[n] = keys[n]
        order[n] = n


@wp.kernel
def measure_kernel(
    stride: int,
    first: int,
    last: int,
    boxes: wp.array2d[int],  # (N, 4)
    sorted: wp.array[int],  # (2 N,)
    # outputs
    order: wp.array[int],  # (N,)
    ranks: wp.array[int],  # (N,)
    counts: wp.array[int],  # (N,)
):
    """Note the splat of a rank, and the number of its entries."""
    for rank in range(first + wp.tid(), last, stride):
        n = sorted[rank]
        order[rank] = n
        ranks[n] = rank
        counts[rank] = boxes[n, 2] * boxes[n, 3]


@wp.kernel
def limit_kernel(
    stride: int,
    first: int,
    last: int,
    # outputs
    ends: wp.array[int],  # (N,): sums of entries, END from the first one beyond int32 on
):
    """Keep the sums from turning negative, and positive again."""
    for _turn in range(first + wp.tid(), last, stride):
        beyond = int(0)
        for rank in range(ends.shape[0]):
            if ends[rank] < 0:
                beyond = 1
            if beyond != 0:
                ends[rank] = END


def sort(screen: codes.Screen, order: wp.array, ranks: wp.array, ends: wp.array) -> None:
    """Order splats by depth, and number their entries, as `Lists` has all three."""
    count, device = order.shape[0], order.device
    keys, values = (scratch(f"splats.{n}", (2 * count,), wp.int32, device) for n in ("keys", "ids"))
    launch_each(number_kernel, count, 2 * count, [screen.keys], [keys, values])
    _sort(keys, values, count, 31)
    launch_each(measure_kernel, count, 4 * count, [screen.boxes, values], [order, ranks, ends])
    scan(ends)
    if not device.is_cuda:
        launch_each(limit_kernel, 1, 1, [], [ends])


def _sort(keys: wp.array, values: wp.array, count: int, bits: int) -> None:
    """Sort by the lower bits of keys; equal keys stay in their order."""
    if keys.device.is_cuda:
        with wp.ScopedStream(current_stream(keys.device), sync_enter=False):
            wp.utils.radix_sort_pairs(keys, values, count, end_bit=bits)
    else:
        wp.utils.radix_sort_pairs(keys, values, count, end_bit=bits)


@wp.func
def begin_of(ends: wp.array[int], rank: int) -> int:
    """Return the first entry of a splat; none follows one beyond the range of sums."""
    begin = int(0)
    if rank > 0:
        begin = ends[rank - 1]
    return wp.where(begin < 0, END, begin)


@wp.func
def tile_of(boxes: wp.array2d[int], n: int, at: int, columns: int) -> int:
    """Return the tile of an entry of a splat."""
    across = boxes[n, 2]
    return (boxes[n, 1] + at // across) * columns + boxes[n, 0] + at % across


@wp.kernel
def tally_kernel(
    stride: int,
    first: int,
    last: int,
    boxes: wp.array2d[int],  # (N, 4)
    columns: int,
    lists: Lists,
    # outputs
    starts: wp.array2d[int],  # (T, PARTS): the number of entries
):
    """Count the entries of a part in each tile."""
    for part in range(first + wp.tid(), last, stride):
        for tile in range(starts.shape[0]):
            starts[tile, part] = 0
        count = lists.order.shape[0]
        begin = int(wp.int64(count) * wp.int64(part) / wp.int64(PARTS))
        end = int(wp.int64(count) * wp.int64(part + 1) / wp.int64(PARTS))
        for rank in range(begin, end):
            n = lists.order[rank]
            entry = begin_of(lists.ends, rank)
            for at in range(wp.min(lists.ends[rank], lists.entries.shape[0]) - entry):
                tile = tile_of(boxes, n, at, columns)
                starts[tile, part] = starts[tile, part] + 1


@wp.kernel
def start_kernel(
    stride: int,
    first: int,
    last: int,
    # outputs
    starts: wp.array2d[int],  # (T, PARTS): counts, replaced by the sums before them
    ranges: wp.array[int],  # (T + 1,)
):
    """Replace counts by the places where entries begin."""
    for turn in range(first + wp.tid(), last, stride):
        total = turn
        for tile in range(starts.shape[0]):
            ranges[tile] = total
            for part in range(PARTS):
                count = starts[tile, part]
                starts[tile, part] = total
                total += count
        ranges[starts.shape[0]] = total


@wp.kernel
def deal_kernel(
    stride: int,
    first: int,
    last: int,
    boxes: wp.array2d[int],  # (N, 4)
    columns: int,
    # outputs
    starts: wp.array2d[int],  # (T, PARTS): where the next entry goes
    lists: Lists,
):
    """Put the entries of a part where they belong."""
    for part in range(first + wp.tid(), last, stride):
        count = lists.order.shape[0]
        begin = int(wp.int64(count) * wp.int64(part) / wp.int64(PARTS))
        end = int(wp.int64(count) * wp.int64(part + 1) / wp.int64(PARTS))
        for rank in range(begin, end):
            n = lists.order[rank]
            entry = begin_of(lists.ends, rank)
            for at in range(wp.min(lists.ends[rank], lists.entries.shape[0]) - entry):
                tile = tile_of(boxes, n, at, columns)
                place = starts[tile, part]
                starts[tile, part] = place + 1
                lists.entries[place] = n
                lists.sources[place] = entry + at


@wp.kernel
def leave_kernel(
    ends: wp.array[int],  # (N,)
    tiles: int,
    # outputs
    keys: wp.array[int],  # (2 E,)
):
    """Put entries that are not used behind all tiles."""
    entry = wp.tid()
    if entry >= ends[ends.shape[0] - 1]:
        keys[entry] = tiles


@wp.kernel
def list_kernel(
    boxes: wp.array2d[int],  # (N, 4)
    columns: int,
    order: wp.array[int],  # (N,)
    ends: wp.array[int],  # (N,)
    # outputs
    keys: wp.array[int],  # (2 E,)
    owners: wp.array[int],  # (E,)
):
    """Write the entries of a splat, with their tiles."""
    rank = wp.tid()
    n = order[rank]
    begin = begin_of(ends, rank)
    for entry in range(begin, wp.min(ends[rank], owners.shape[0])):
        keys[entry] = tile_of(boxes, n, entry - begin, columns)
        owners[entry] = n


@wp.kernel
def range_kernel(
    keys: wp.array[int],  # (2 E,)
    sorted: wp.array[int],  # (2 E,)
    owners: wp.array[int],  # (E,)
    # outputs
    lists: Lists,
):
    """Note where tiles begin, and the splats of entries."""
    place = wp.tid()
    tiles = lists.ranges.shape[0] - 1
    tile = keys[place]
    before = int(-1)
    if place > 0:
        before = keys[place - 1]
    for k in range(before + 1, tile + 1):
        lists.ranges[k] = place
    if place == lists.entries.shape[0] - 1:
        for k in range(tile + 1, tiles + 1):
            lists.ranges[k] = place + 1
    if tile < tiles:
        source = sorted[place]
        lists.sources[place] = source
        lists.entries[place] = owners[source]


def fill(screen: codes.Screen, columns: int, lists: codes.Lists) -> None:
    """List the entries of each tile, front to back; a row of the screen has `columns` tiles.

    `order` and `ends` are those of :func:`sort`; the rest of `lists` is filled.
    """
    device, made = lists.order.device, struct_of(Lists, lists)
    count, room = lists.order.shape[0], lists.entries.shape[0]
    tiles = lists.ranges.shape[0] - 1
    if not device.is_cuda:
        starts = scratch("splats.starts", (tiles, int(PARTS)), wp.int32, device)
        work = 2 * (count + tiles * int(PARTS))
        inputs = [screen.boxes, columns]
        launch_each(tally_kernel, int(PARTS), work, [*inputs, made], [starts])
        launch_each(start_kernel, 1, 1, [], [starts, lists.ranges])
        launch_each(deal_kernel, int(PARTS), work, inputs, [starts, made])
        return
    keys, values = (scratch(f"splats.{n}", (2 * room,), wp.int32, device) for n in ("tiles", "at"))
    owners = scratch("splats.owners", (room,), wp.int32, device)
    launch_each(number_kernel, room, room, [lists.sources], [keys, values])
    launch(leave_kernel, room, [lists.ends, tiles], [keys])
    launch(list_kernel, count, [screen.boxes, columns, lists.order, lists.ends], [keys, owners])
    _sort(keys, values, room, tiles.bit_length())
    launch(range_kernel, room, [keys, values, owners], [made])
