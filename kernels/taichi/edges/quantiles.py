"""Order statistics of an image's gradients, as thresholds, in Taichi.

The bit patterns of floats >= 0 have the order of their values, so a histogram of each digit in turn
finds an order statistic. All counts are integers, so the result is exact, and the same on every
device. One thread per pixel counts; one thread chooses the digit.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.edges import BINS, DIGITS, Norm
from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi._polar import squared_magnitude

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)


@ti.func
def _bits_of(dy: ti.f32, dx: ti.f32, norm: ti.i32, zero: ti.i32) -> ti.i32:
    """Return the bits of the value that thresholds are compared with; NaN counts as 0."""
    m = ti.abs(dx) + ti.abs(dy)
    if norm == Norm.L2:
        m = squared_magnitude(dy, dx, zero)
    bits = 0
    if m > 0.0:
        bits = ti.bit_cast(m, ti.i32)
    return bits


@ti.kernel
def _begin(
    ranks: i32_1,
    # outputs
    found: i32_2,  # (3, 2): for both ranks the digits so far and the rank left; the largest bits
):
    for i in range(2):
        found[i, 0] = 0
        found[i, 1] = ranks[i]
    found[2, 0] = 0


@ti.kernel
def _count(
    dy: f32_2,
    dx: f32_2,
    norm: ti.i32,
    shift: ti.i32,
    width: ti.i32,
    zero: ti.i32,
    # outputs
    found: i32_2,
    counts: i32_2,  # (2, BINS)
):
    for i, k in counts:
        counts[i, k] = 0
    for y, x in dy:
        bits = _bits_of(dy[y, x], dx[y, x], norm, zero)
        digit = (bits >> shift) & ((1 << width) - 1)
        for i in ti.static(range(2)):
            if bits >> (shift + width) == found[i, 0]:
                ti.atomic_add(counts[i, digit], 1)
        if bits > found[2, 0]:
            ti.atomic_max(found[2, 0], bits)


@ti.kernel
def _choose(
    counts: i32_2,
    width: ti.i32,
    # outputs
    found: i32_2,
):
    for i in range(2):
        rank = found[i, 1]
        below = 0
        digit = 0
        passed = 0
        for k in range(1 << width):
            below += counts[i, k]
            if below <= rank:
                digit = k + 1
                passed = below
        found[i, 0] = (found[i, 0] << width) | digit
        found[i, 1] = rank - passed


@ti.kernel
def _finish(
    found: i32_2,
    norm: ti.i32,
    strict: ti.i32,
    share: ti.f32,
    # outputs
    limits: f32_1,
):
    for i in range(2):
        bits = found[i, 0]
        if strict == 0:
            bits = ti.max(bits - 1, 0)
        least = 0.0
        if share > 0.0:  # 0 times infinity would be NaN
            least = ti.bit_cast(found[2, 0], ti.f32) * share
            if norm == Norm.L2:
                least = least * share
        limits[i] = ti.max(ti.bit_cast(bits, ti.f32), least)


@primitive
def find_limits(
    dy: np.ndarray,
    dx: np.ndarray,
    norm: int,
    ranks: np.ndarray,
    strict: bool,
    share: float,
    limits: np.ndarray,
) -> None:
    """Find two order statistics of the gradient's length; one thread per pixel counts a digit."""
    found = scratch((3, 2), np.int32)
    counts = scratch((2, BINS), np.int32)
    _begin(ranks, found)
    for shift, width in DIGITS:
        _count(dy, dx, norm, shift, width, 0, found, counts)
        _choose(counts, width, found)
    _finish(found, norm, int(strict), share, limits)
