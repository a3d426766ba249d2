"""The best keypoints by (response, position), in Taichi.

With a budget the points of the largest responses are kept; of equal ones, the first. Spread means:
the image is cut into squares, and the best of every square come first, then their second best, and
so on: points have ranks in their squares, and a lower rank goes before a larger response. A point
takes a thread; one thread selects, byte by byte of rank and response.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi._rounding import wide_product

i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)


@primitive
def place(
    cells: np.ndarray,
    offsets: np.ndarray,
    step: float,
    mask: np.ndarray,
    side: float,
    across: int,
    points: np.ndarray,
    values: np.ndarray,
    squares: np.ndarray,
) -> None:
    """Map points to the image; give each its response as an integer, and a square of a grid.

    `step` is a pixel of the first octave in the image, `side` that of a square; a row has `across`
    squares. The value of a point is the bits of its response, or -1 where the mask is 0.
    """
    _place(cells, offsets, step, mask, side, across, 0, points, values, squares)


@ti.kernel
def _place(
    cells: i32_2,  # (N, 4)
    offsets: f32_2,  # (N, 4)
    step: ti.f64,
    mask: u8_2,
    side: ti.f64,
    across: ti.i32,
    zero: ti.i32,
    # outputs
    points: f32_2,
    values: i32_1,
    squares: i32_1,
):
    for n in values:
        scale = step
        for _ in range(cells[n, 0]):
            scale = scale + scale
        place = ti.Vector([0, 0], ti.i32)
        square = ti.Vector([0, 0], ti.i32)
        for i in ti.static(range(2)):
            moved = ti.cast(cells[n, 2 + i], ti.f64) + ti.cast(offsets[n, i], ti.f64)
            p = ti.cast(wide_product(moved, scale, zero), ti.f32)
            points[n, i] = p
            near = ti.cast(ti.floor(ti.cast(p, ti.f64) + 0.5), ti.i32)
            place[i] = ti.max(0, ti.min(near, mask.shape[i] - 1))
            square[i] = ti.cast(ti.cast(p, ti.f64) / side, ti.i32)
        values[n] = ti.bit_cast(offsets[n, 3], ti.i32)
        if mask[place[0], place[1]] == 0:
            values[n] = -1
        squares[n] = square[0] * across + square[1]


@primitive
def rank(values: np.ndarray, squares: np.ndarray, count: int, ranks: np.ndarray) -> None:
    """Count the points of the same square, of `count`, with larger values; of equal ones, before.

    A value below 0 is no point.
    """
    ends, members = scratch((count + 1,), np.int32), scratch(values.shape, np.int32)
    _clear(ends)
    _count(values, squares, ends)
    _add_up(ends)
    _gather(values, squares, ends, members)
    _rank(values, squares, ends, members, ranks)


@ti.kernel
def _clear(counts: i32_1):
    for n in counts:
        counts[n] = 0


@ti.kernel
def _count(
    values: i32_1,
    squares: i32_1,
    # outputs
    counts: i32_1,
):
    for n in values:
        if values[n] >= 0:
            ti.atomic_add(counts[squares[n]], 1)


@ti.kernel
def _add_up(counts: i32_1):
    for _ in range(1):
        total = 0
        for n in range(counts.shape[0]):
            total += counts[n]
            counts[n] = total


@ti.kernel
def _gather(
    values: i32_1,
    squares: i32_1,
    # in place: the ends of squares become their beginnings
    ends: i32_1,
    # outputs
    members: i32_1,
):
    for n in values:
        if values[n] >= 0:
            # The order within a square has no effect.
            members[ti.atomic_sub(ends[squares[n]], 1) - 1] = n


@ti.kernel
def _rank(
    values: i32_1,
    squares: i32_1,
    begins: i32_1,
    members: i32_1,
    # outputs
    ranks: i32_1,
):
    for n in values:
        better = 0
        if values[n] >= 0:
            for k in range(begins[squares[n]], begins[squares[n] + 1]):
                other = members[k]
                larger = values[other] > values[n]
                if larger or (values[other] == values[n] and other < n):
                    better += 1
        ranks[n] = better


@primitive
def choose(
    values: np.ndarray, ranks: np.ndarray, ranked: int, number: np.ndarray, chosen: np.ndarray
) -> None:
    """List the points of lowest rank, then of largest value, then the first ones, in their order.

    `chosen` (M,) has room for as many as wanted, of which `number` (1,) are written. A value below
    0 is no point. Without `ranked` all ranks are equal.
    """
    _choose(values, ranks, ranked, scratch((256,), np.int32), number, chosen)


@ti.func
def _key(values: ti.template(), ranks: ti.template(), ranked: ti.i32, n: ti.i32) -> ti.i64:
    """Return a number that is smaller for a better point."""
    key = ti.cast(0x7FFFFFFF - values[n], ti.i64)
    if ranked == 1:
        key += ti.cast(ranks[n], ti.i64) << 32
    return key


@ti.kernel
def _choose(
    values: i32_1,
    ranks: i32_1,
    ranked: ti.i32,
    bins: i32_1,
    # outputs
    number: i32_1,
    chosen: i32_1,
):
    for _ in range(1):
        there = 0
        for n in range(values.shape[0]):
            if values[n] >= 0:
                there += 1
        # All keys below `prefix` are listed, and the first `missing` of those equal to it.
        prefix = ti.cast(0, ti.i64)
        missing = chosen.shape[0]
        if there > chosen.shape[0]:
            for part in range(8):
                shift = ti.cast(8 * (7 - part), ti.i64)
                for b in range(256):
                    bins[b] = 0
                for n in range(values.shape[0]):
                    if values[n] >= 0:
                        key = _key(values, ranks, ranked, n)
                        if ((key ^ prefix) >> shift) >> 8 == 0:
                            bins[ti.cast((key >> shift) & 255, ti.i32)] += 1
                b = 0
                while b < 255 and bins[b] < missing:
                    missing -= bins[b]
                    b += 1
                prefix = prefix | (ti.cast(b, ti.i64) << shift)
        at = 0
        for n in range(values.shape[0]):
            if values[n] >= 0:
                key = _key(values, ranks, ranked, n)
                kept = there <= chosen.shape[0] or key < prefix
                if not kept and key == prefix and missing > 0:
                    missing -= 1
                    kept = True
                if kept:
                    chosen[at] = n
                    at += 1
        number[0] = at
