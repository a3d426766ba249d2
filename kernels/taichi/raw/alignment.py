"""Median threshold bitmaps, in Taichi.

Whether a pixel is above the median of its image hardly depends on the exposure [G. Ward, "Fast,
robust image registration for compositing high dynamic range photographs from hand-held exposures",
Journal of Graphics Tools 8(2), 2003]. Grey values are levels of 16 bits between the least and the
largest of an image; all that follows are integers. Each kernel takes one thread a pixel.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.raw import GREYS, MOVES, SLOTS
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._order import ordered
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
        key = ti.cast(ordered(ti.bit_cast(mean, ti.i32)), ti.i64) + ti.i64(2**31)
        ti.atomic_max(ends[k, 0], ti.i64(2**32) - key)
        ti.atomic_max(ends[k, 1], key)


@primitive
def mix(frames: np.ndarray, share: float, grey: np.ndarray, ends: np.ndarray) -> None:
    """Write the means of (K, N, C) values, each with its share, and the keys of both ends, (K, 2).

    A key is the bits of a float32 as an integer of the same order, plus 2^31; that of the least is
    taken off 2^32, so that both are maxima.
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
def _compare(sides: u8_3, k: ti.i32, fixed: ti.i32, dy: ti.i32, dx: ti.i32, sums: i32_2):
    for y, x in ti.ndrange(sides.shape[1], sides.shape[2]):
        there = ti.cast(sides[fixed, y, x], ti.i32)
        if there > 0:
            for n in ti.static(range(len(MOVES))):
                v, u = y - dy - MOVES[n][0], x - dx - MOVES[n][1]
                if 0 <= v < sides.shape[1] and 0 <= u < sides.shape[2]:
                    if ti.cast(sides[k, v, u], ti.i32) + there == 3:
                        ti.atomic_add(sums[(y * sides.shape[2] + x) % SLOTS, n], 1)


@primitive
def compare(sides: np.ndarray, k: int, fixed: int, dy: int, dx: int, sums: np.ndarray) -> None:
    """Count where image k, moved by (dy, dx) and one of MOVES, is on the other side.

    The counts of a move are spread over SLOTS sums.
    """
    _compare(sides, k, fixed, dy, dx, sums)
