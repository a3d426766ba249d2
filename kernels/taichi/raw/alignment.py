"""Median threshold bitmaps, in Taichi.

Whether a pixel is above the median of its image hardly depends on the exposure [G. Ward, "Fast,
robust image registration for compositing high dynamic range photographs from hand-held exposures",
Journal of Graphics Tools 8(2), 2003]. Grey values are levels of 16 bits between the least and the
largest of an image; all that follows are integers. Each kernel takes one thread a pixel.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.raw import GREYS, GROUP, MOVES, PARTS
from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi._order import key_of
from cvkern.kernels.taichi._rounding import product

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
any_3 = ti.types.ndarray(ndim=3)  # u8, u16 or f32
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
i32_3 = ti.types.ndarray(dtype=ti.i32, ndim=3)
i64_2 = ti.types.ndarray(dtype=ti.i64, ndim=2)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)
u8_3 = ti.types.ndarray(dtype=ti.u8, ndim=3)


@ti.kernel
def _mix(frames: any_3, share: ti.f32, zero: ti.i32, grey: f32_2, ends: i64_2):
    for k, i in grey:
        total = 0.0
        for c in range(frames.shape[2]):
            v = ti.cast(frames[k, i, c], ti.f32)
            total += v if ti.abs(v) < 1e30 else 0.0
        mean = product(total, share, zero)
        grey[k, i] = mean
        key = key_of(mean)
        ti.atomic_max(ends[k, 0], ti.i64(2**32) - key)
        ti.atomic_max(ends[k, 1], key)


@primitive
def mix(frames: np.ndarray, share: float, grey: np.ndarray, ends: np.ndarray) -> None:
    """Write the means of (K, N, C) values, each with its share, and the keys of both ends, (K, 2).

    Keys are those of `key_of`; that of the least is taken off 2^32, so that both are maxima.
    """
    _mix(frames, share, 0, grey, ends)


@ti.kernel
def _grade(grey: f32_2, scales: f32_2, zero: ti.i32, levels: i32_2):
    for k, i in levels:
        level = ti.cast(product(grey[k, i] - scales[k, 0], scales[k, 1], zero), ti.i32)
        levels[k, i] = ti.math.clamp(level, 0, GREYS - 1)


@primitive
def grade(grey: np.ndarray, scales: np.ndarray, levels: np.ndarray) -> None:
    """Write the level of each value; `scales` (K, 2) has the least one and the levels a unit."""
    _grade(grey, scales, 0, levels)


@ti.kernel
def _halve(src: i32_3, dst: i32_3):
    for k, y, x in dst:
        above = src[k, 2 * y, 2 * x] + src[k, 2 * y, 2 * x + 1]
        below = src[k, 2 * y + 1, 2 * x] + src[k, 2 * y + 1, 2 * x + 1]
        dst[k, y, x] = (above + below) // 4


@primitive
def halve(src: np.ndarray, dst: np.ndarray) -> None:
    """Write the means of blocks of 2 x 2 pixels, rounded down."""
    _halve(src, dst)


@ti.kernel
def _count(levels: i32_2, counts: i32_2):
    for k, i in levels:
        ti.atomic_add(counts[k, levels[k, i]], 1)


@primitive
def count(levels: np.ndarray, counts: np.ndarray) -> None:
    """Count the pixels (K, N) of each level, (K, GREYS)."""
    _count(levels, counts)


@ti.kernel
def _add_up(counts: i32_2, parts: i32_2):
    for k, g in parts:
        total = 0
        for i in range(GROUP):
            total += counts[k, g * GROUP + i]
        parts[k, g] = total


@ti.kernel
def _medians(counts: i32_2, parts: i32_2, found: i32_1):
    for k in found:
        total = ti.i64(0)
        for g in range(parts.shape[1]):
            total += parts[k, g]
        group, level, below, rest = 0, 0, ti.i64(0), ti.i64(0)
        for g in range(parts.shape[1]):
            below += parts[k, g]
            if 2 * below < total:
                group, rest = g + 1, below
        for i in range(GROUP):
            rest += counts[k, group * GROUP + i]
            if 2 * rest < total:
                level = i + 1
        found[k] = group * GROUP + level


@primitive
def medians(counts: np.ndarray, found: np.ndarray) -> None:
    """Write the lower median of each image's levels, of which `counts` (K, GREYS) tell.

    One thread a group of levels, then one an image.
    """
    parts = scratch((counts.shape[0], GREYS // GROUP), np.int32)
    _add_up(counts, parts)
    _medians(counts, parts, found)


@ti.kernel
def _split(levels: i32_2, medians: i32_1, noise: ti.i32, sides: u8_2):
    for k, i in levels:
        off = levels[k, i] - medians[k]
        side = 0
        if off > noise:
            side = 2
        elif off < -noise:
            side = 1
        sides[k, i] = ti.cast(side, ti.u8)


@primitive
def split(levels: np.ndarray, medians: np.ndarray, noise: int, sides: np.ndarray) -> None:
    """Write 2 above the median of (K, N) levels, 1 below, 0 within `noise` of it."""
    _split(levels, medians, noise, sides)


@ti.kernel
def _compare(sides: u8_3, fixed: ti.i32, shifts: i32_2, sums: i32_3):
    for k, y, x in sides:
        there = ti.cast(sides[fixed, y, x], ti.i32)
        if there > 0:
            for n in ti.static(range(len(MOVES))):
                v = y - 2 * shifts[k, 0] - MOVES[n][0]
                u = x - 2 * shifts[k, 1] - MOVES[n][1]
                if 0 <= v < sides.shape[1] and 0 <= u < sides.shape[2]:
                    if ti.cast(sides[k, v, u], ti.i32) + there == 3:
                        ti.atomic_add(sums[k, (y * sides.shape[2] + x) % PARTS, n], 1)


@primitive
def compare(sides: np.ndarray, fixed: int, shifts: np.ndarray, sums: np.ndarray) -> None:
    """Count where each image, moved by its shift doubled and one of MOVES, is on the other side.

    The counts of a move are spread over PARTS sums, (K, PARTS, MOVES), which are 0 before. One
    thread a pixel.
    """
    _compare(sides, fixed, shifts, sums)


@ti.kernel
def _choose(sums: i32_3, height: ti.i32, width: ti.i32, shifts: i32_2):
    for k in range(shifts.shape[0]):
        dy, dx = 2 * shifts[k, 0], 2 * shifts[k, 1]
        best, off, size = 0, ti.i64(0), ti.i64(0)
        for n in ti.static(range(len(MOVES))):
            differ = ti.i64(0)
            for part in range(PARTS):
                differ += sums[k, part, n]
            tall = ti.max(height - ti.abs(dy + MOVES[n][0]), 0)
            common = ti.cast(tall, ti.i64) * ti.max(width - ti.abs(dx + MOVES[n][1]), 0)
            if common > 0 and (size == 0 or differ * size < off * common):
                best, off, size = n, differ, common
        for n in ti.static(range(len(MOVES))):
            if n == best:
                shifts[k, 0], shifts[k, 1] = dy + MOVES[n][0], dx + MOVES[n][1]


@primitive
def choose(sums: np.ndarray, height: int, width: int, shifts: np.ndarray) -> None:
    """Double each shift and add the move with the smallest share of pixels that differ.

    On a tie it is the first of MOVES; without common pixels, none. One thread an image.
    """
    _choose(sums, height, width, shifts)
