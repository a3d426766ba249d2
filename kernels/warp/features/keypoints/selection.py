"""The best keypoints by (response, position), in Warp.

The Taichi set has the rules. A thread takes a point; on the CPU, one thread selects, and on CUDA
one block (_selection_cuda.py).
"""

import warp as wp

from cvkern.kernels.warp._launch import launch, launch_each, scratch
from cvkern.kernels.warp._sums import scan
from cvkern.kernels.warp._zeros import clear

from . import _selection_cuda as cuda

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


def place(
    cells: wp.array,
    offsets: wp.array,
    step: float,
    mask: wp.array,
    side: float,
    across: int,
    points: wp.array,
    values: wp.array,
    squares: wp.array,
) -> None:
    """Map points to the image; give each its response as an integer, and a square of a grid.

    `step` is a pixel of the first octave in the image, `side` that of a square; a row has `across`
    squares. The value of a point is the bits of its response, or -1 where the mask is 0.
    """
    count = cells.shape[0]
    inputs = [cells, offsets, wp.float64(step), mask, wp.float64(side), across]
    launch_each(_place, count, 8 * count, inputs, [points, values, squares])


def rank(values: wp.array, squares: wp.array, count: int, ranks: wp.array) -> None:
    """Count the points of the same square, of `count`, with larger values; of equal ones, before.

    A value below 0 is no point.
    """
    points, device = values.shape[0], values.device
    ends = scratch("selection.ends", (count + 1,), wp.int32, device)
    members = scratch("selection.members", (points,), wp.int32, device)
    clear(ends)
    launch_each(_count, points, 0, [values, squares], [ends])  # no atomics between slabs
    scan(ends)
    launch_each(_gather, points, 0, [values, squares], [ends, members])
    launch_each(_rank, points, 64 * points, [values, squares, ends, members], [ranks])


def choose(
    values: wp.array, ranks: wp.array, ranked: int, number: wp.array, chosen: wp.array
) -> None:
    """List the points of lowest rank, then of largest value, then the first ones, in their order.

    `chosen` (M,) has room for as many as wanted, of which `number` (1,) are written. A value below
    0 is no point. Without `ranked` all ranks are equal.
    """
    inputs, outputs = [values, ranks, ranked], [number, chosen]
    if values.device.is_cuda:
        launch(cuda.choose, cuda.THREADS, inputs, outputs, cuda.THREADS)
        return
    bins = scratch("selection.bins", (256,), wp.int32, values.device)
    launch(_choose, 1, [*inputs, bins], outputs)


@wp.kernel
def _place(
    stride: int,
    first: int,
    last: int,
    cells: wp.array2d[int],  # (N, 4)
    offsets: wp.array2d[float],  # (N, 4)
    step: wp.float64,
    mask: wp.array2d[wp.uint8],
    side: wp.float64,
    across: int,
    # outputs
    points: wp.array2d[float],
    values: wp.array[int],
    squares: wp.array[int],
):
    half = wp.float64(0.5)
    for n in range(first + wp.tid(), last, stride):
        scale = step
        for _ in range(cells[n, 0]):
            scale = scale + scale
        y = float((wp.float64(cells[n, 2]) + wp.float64(offsets[n, 0])) * scale)
        x = float((wp.float64(cells[n, 3]) + wp.float64(offsets[n, 1])) * scale)
        points[n, 0] = y
        points[n, 1] = x
        row = wp.clamp(int(wp.floor(wp.float64(y) + half)), 0, mask.shape[0] - 1)
        column = wp.clamp(int(wp.floor(wp.float64(x) + half)), 0, mask.shape[1] - 1)
        value = wp.cast(offsets[n, 3], wp.int32)
        values[n] = wp.where(mask[row, column] == wp.uint8(0), -1, value)
        squares[n] = int(wp.float64(y) / side) * across + int(wp.float64(x) / side)


@wp.kernel
def _count(
    stride: int,
    first: int,
    last: int,
    values: wp.array[int],
    squares: wp.array[int],
    # outputs
    counts: wp.array[int],
):
    for n in range(first + wp.tid(), last, stride):
        if values[n] >= 0:
            wp.atomic_add(counts, squares[n], 1)


@wp.kernel
def _gather(
    stride: int,
    first: int,
    last: int,
    values: wp.array[int],
    squares: wp.array[int],
    # in place: the ends of squares become their beginnings
    ends: wp.array[int],
    # outputs
    members: wp.array[int],
):
    for n in range(first + wp.tid(), last, stride):
        if values[n] >= 0:
            # The order within a square has no effect.
            members[wp.atomic_sub(ends, squares[n], 1) - 1] = n


@wp.kernel
def _rank(
    stride: int,
    first: int,
    last: int,
    values: wp.array[int],
    squares: wp.array[int],
    begins: wp.array[int],
    members: wp.array[int],
    # outputs
    ranks: wp.array[int],
):
    for n in range(first + wp.tid(), last, stride):
        value = values[n]
        better = int(0)
        if value >= 0:
            for k in range(begins[squares[n]], begins[squares[n] + 1]):
                other = members[k]
                if values[other] > value or (values[other] == value and other < n):
                    better += 1
        ranks[n] = better


@wp.func
def key_of(values: wp.array[int], ranks: wp.array[int], ranked: int, n: int) -> wp.int64:
    """Return a number that is smaller for a better point."""
    key = wp.int64(0x7FFFFFFF - values[n])
    if ranked == 1:
        key += wp.int64(ranks[n]) << wp.int64(32)
    return key


@wp.kernel
def _choose(
    values: wp.array[int],
    ranks: wp.array[int],
    ranked: int,
    bins: wp.array[int],
    # outputs
    number: wp.array[int],
    chosen: wp.array[int],
):
    most = chosen.shape[0]
    there = int(0)
    largest = wp.int64(0)
    for n in range(values.shape[0]):
        if values[n] >= 0:
            there += 1
            largest = wp.max(largest, key_of(values, ranks, ranked, n))
    # All keys below `prefix` are listed, and the first `missing` of those that are equal to it.
    prefix = wp.int64(0x7FFFFFFFFFFFFFFF)
    missing = int(0)
    if there > most:
        prefix = wp.int64(0)
        missing = most
        shift = wp.int64(56)
        while shift > wp.int64(0) and (largest >> shift) == wp.int64(0):
            shift -= wp.int64(8)
        while shift >= wp.int64(0):
            for b in range(256):
                bins[b] = 0
            for n in range(values.shape[0]):
                if values[n] >= 0:
                    key = key_of(values, ranks, ranked, n)
                    if (((key ^ prefix) >> shift) >> wp.int64(8)) == wp.int64(0):
                        bins[int((key >> shift) & wp.int64(255))] += 1
            b = int(0)
            while b < 255 and bins[b] < missing:
                missing -= bins[b]
                b += 1
            prefix = prefix | (wp.int64(b) << shift)
            shift -= wp.int64(8)
    at = int(0)
    for n in range(values.shape[0]):
        if values[n] >= 0:
            key = key_of(values, ranks, ranked, n)
            kept = key < prefix
            if key == prefix and missing > 0:
                missing -= 1
                kept = True
            if kept:
                chosen[at] = n
                at += 1
    number[0] = at
