"""Semi-global matching in Taichi: path costs, and the winner of each pixel."""

import numpy as np
import taichi as ti

from ..codes import (
    CENSUS_WEIGHT,
    DIFFERENCE_LIMIT,
    DIFFERENCE_SHIFT,
    Subpixel,
)
from ._launch import primitive, scratch
from ._rounding import quotient
from ._windows import ones

any_3 = ti.types.ndarray(ndim=3)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
i32_3 = ti.types.ndarray(dtype=ti.i32, ndim=3)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)
u8_3 = ti.types.ndarray(dtype=ti.u8, ndim=3)
u16_1 = ti.types.ndarray(dtype=ti.u16, ndim=1)
u16_3 = ti.types.ndarray(dtype=ti.u16, ndim=3)
u64_2 = ti.types.ndarray(dtype=ti.u64, ndim=2)


@ti.func
def _start(c: ti.i32, dy: ti.i32, dx: ti.i32, height: ti.i32, width: ti.i32) -> ti.math.ivec2:
    """Return where the path number `c` of direction (dy, dx) enters the image."""
    rows = ti.min(ti.abs(dy), height)  # paths begin in this many rows of one edge ...
    columns = ti.min(ti.abs(dx), width)  # ... and in this many columns of another
    y = 0
    x = 0
    if c < rows * width:
        y = c // width
        x = c % width
    else:
        y = rows + (c - rows * width) // columns
        x = (c - rows * width) % columns
    if dy < 0:
        y = height - 1 - y
    if dx < 0:
        x = width - 1 - x
    return ti.Vector([y, x])


@ti.kernel
def _walk(
    costs: any_3,  # (H, W, D)
    guide: u8_2,  # (H, W), or (1, 1) where there is none
    p1: ti.i32,
    p2_of: u16_1,  # (256,) by how much the guide changes along the path
    count: ti.i32,  # how many paths there are
    dy: ti.i32,
    dx: ti.i32,
    first: ti.i32,  # whether nothing has been summed yet
    lines: i32_3,  # (2, count, D) scratch
    top: ti.i32,
    # outputs
    sums: u16_3,  # (h, W, D), rows of the image from `top` on
):
    height = costs.shape[0]
    width = costs.shape[1]
    depth = costs.shape[2]
    for c in range(count):
        position = _start(c, dy, dx, height, width)
        y = position[0]
        x = position[1]
        lowest = 0  # the minimum over d at the pixel before
        new = 0  # which of the two lines is this pixel's
        begun = 0
        while 0 <= y < height and 0 <= x < width:
            p2 = ti.cast(p2_of[0], ti.i32)
            if begun == 1 and guide.shape[0] == height and guide.shape[1] == width:
                step = ti.cast(guide[y, x], ti.i32) - ti.cast(guide[y - dy, x - dx], ti.i32)
                p2 = ti.cast(p2_of[ti.abs(step)], ti.i32)
            least = 1 << 30
            for d in range(depth):
                value = ti.cast(costs[y, x, d], ti.i32)
                if begun == 1:
                    best = ti.min(lines[1 - new, c, d], lowest + p2)
                    if d > 0:
                        best = ti.min(best, lines[1 - new, c, d - 1] + p1)
                    if d < depth - 1:
                        best = ti.min(best, lines[1 - new, c, d + 1] + p1)
                    value += best - lowest
                lines[new, c, d] = value
                least = ti.min(least, value)
                if 0 <= y - top < sums.shape[0]:
                    total = value
                    if first == 0:
                        total += ti.cast(sums[y - top, x, d], ti.i32)
                    sums[y - top, x, d] = ti.cast(total, ti.u16)
            lowest = least
            new = 1 - new
            begun = 1
            y += dy
            x += dx


# The directions of the first 4, 8 and 16 paths.
_STEPS = (
    *((0, 1), (0, -1), (1, 0), (-1, 0)),
    *((1, 1), (1, -1), (-1, 1), (-1, -1)),
    *((1, 2), (1, -2), (-1, 2), (-1, -2)),
    *((2, 1), (2, -1), (-2, 1), (-2, -1)),
)


def _aggregate(
    costs: np.ndarray,
    guide: np.ndarray,
    p1: int,
    p2: np.ndarray,
    paths: int,
    top: int,
    sums: np.ndarray,
) -> None:
    height, width, depth = costs.shape
    for i, (dy, dx) in enumerate(_STEPS[:paths]):
        rows, columns = min(abs(dy), height), min(abs(dx), width)
        count = rows * width + columns * (height - rows)
        lines = scratch((2, count, depth), np.int32)
        _walk(costs, guide, p1, p2, count, dy, dx, int(i == 0), lines, top, sums)


@primitive
def aggregate(
    costs: np.ndarray,
    guide: np.ndarray,
    p1: int,
    p2: np.ndarray,
    p2_max: int,
    paths: int,
    top: int,
    sums: np.ndarray,
) -> None:
    """Sum the costs of the cheapest paths to each pixel; one thread per path."""
    _aggregate(costs, guide, p1, p2, paths, top, sums)


@ti.kernel
def _largest(
    costs: any_3,  # (H, W, D)
    # outputs
    most: i32_2,  # (H, W)
):
    for y, x in most:
        m = 0
        for d in range(costs.shape[2]):
            m = ti.max(m, ti.cast(costs[y, x, d], ti.i32))
        most[y, x] = m


@primitive
def largest(costs: np.ndarray, most: np.ndarray) -> None:
    """Find the largest cost of each pixel; one thread per pixel."""
    _largest(costs, most)


@ti.kernel
def _pick(
    costs: any_3,  # (H, W, D)
    first: ti.i32,
    subpixel: ti.i32,
    uniqueness: ti.i32,
    zero: ti.i32,
    # outputs, all (H, W)
    index: i32_2,
    disparity: f32_2,
    cost: f32_2,
    confidence: f32_2,
):
    # Float32 holds integer costs, and the products with percentages below, exactly.
    depth = costs.shape[2]
    for y, x in index:
        best = ti.math.inf
        k = 0
        for d in range(depth):
            c = ti.cast(costs[y, x, d], ti.f32)
            if c < best:
                best = c
                k = d
        second = ti.math.inf
        for d in range(depth):
            if ti.abs(d - k) > 1:
                second = ti.min(second, ti.cast(costs[y, x, d], ti.f32))
        cost[y, x] = best
        certain = 0.0
        if second > best:
            certain = ti.min(ti.max(1.0 - quotient(best, second, zero), 0.0), 1.0)
        confidence[y, x] = certain
        if uniqueness > 0 and second * (100.0 - uniqueness) < best * 100.0:
            index[y, x] = -1
            disparity[y, x] = ti.bit_cast(0x7FC00000, ti.f32)  # NaN, with these bits everywhere
        else:
            offset = 0.0
            if subpixel != Subpixel.NONE and 0 < k < depth - 1:
                a = ti.cast(costs[y, x, k - 1], ti.f32) - best
                b = ti.cast(costs[y, x, k + 1], ti.f32) - best
                n = a - b
                m = a + b if subpixel == Subpixel.PARABOLA else ti.max(a, b)
                if 0.0 < m < ti.math.inf and ti.abs(n) < ti.math.inf:
                    offset = 0.5 * quotient(n, m, zero)
            index[y, x] = k
            disparity[y, x] = ti.cast(first + k, ti.f32) + offset


@primitive
def pick(
    costs: np.ndarray,
    first: int,
    subpixel: int,
    uniqueness: int,
    index: np.ndarray,
    disparity: np.ndarray,
    cost: np.ndarray,
    confidence: np.ndarray,
) -> None:
    """Take the smallest cost of each pixel; one thread per pixel."""
    _pick(costs, first, subpixel, uniqueness, 0, index, disparity, cost, confidence)


@ti.kernel
def _pick_right(
    costs: any_3,  # (H, W, D)
    first: ti.i32,
    # outputs
    index: i32_2,  # (H, W)
):
    for y, x in index:
        best = ti.math.inf
        k = -1
        for d in range(costs.shape[2]):
            left = x + first + d
            if 0 <= left < costs.shape[1]:
                c = ti.cast(costs[y, left, d], ti.f32)
                if k < 0 or c < best:
                    best = c
                    k = d
        index[y, x] = k


@primitive
def pick_right(costs: np.ndarray, first: int, index: np.ndarray) -> None:
    """Take the smallest cost of each pixel of the right image; one thread per pixel."""
    _pick_right(costs, first, index)


@ti.kernel
def _match_costs(
    left_bits: u64_2,
    right_bits: u64_2,
    left: u8_2,
    right: u8_2,
    first: ti.i32,
    # outputs
    costs: u8_3,  # (H, W, D)
):
    for y, x, k in costs:
        there = ti.max(0, ti.min(costs.shape[1] - 1, x - first - k))
        count = ones(left_bits[y, x] ^ right_bits[y, there])
        grey = ti.abs(ti.cast(left[y, x], ti.i32) - ti.cast(right[y, there], ti.i32))
        limited = ti.min(grey >> DIFFERENCE_SHIFT, DIFFERENCE_LIMIT)
        costs[y, x, k] = ti.cast(CENSUS_WEIGHT * count + limited, ti.u8)


@primitive
def match_costs(
    left_bits: np.ndarray,
    right_bits: np.ndarray,
    left: np.ndarray,
    right: np.ndarray,
    first: int,
    costs: np.ndarray,
) -> None:
    """Compare census and grey value of the pixels of a pair; one thread per disparity."""
    _match_costs(left_bits, right_bits, left, right, first, costs)


@primitive
def match(
    left_bits: np.ndarray,
    right_bits: np.ndarray,
    left: np.ndarray,
    right: np.ndarray,
    first: int,
    count: int,
    p1: int,
    p2: np.ndarray,
    p2_max: int,
    paths: int,
    subpixel: int,
    uniqueness: int,
    top: int,
    index: np.ndarray,
    disparity: np.ndarray,
    cost: np.ndarray,
    confidence: np.ndarray,
    right_index: np.ndarray,
) -> None:
    """Do `match_costs`, `aggregate` along the left image, `pick` and `pick_right`."""
    costs = scratch((*left.shape, count), np.uint8)
    sums = scratch((*index.shape, count), np.uint16)
    _match_costs(left_bits, right_bits, left, right, first, costs)
    _aggregate(costs, left, p1, p2, paths, top, sums)
    _pick(sums, first, subpixel, uniqueness, 0, index, disparity, cost, confidence)
    _pick_right(sums, first, right_index)
