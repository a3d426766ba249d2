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
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)  # (images, rows, columns)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_3 = ti.types.ndarray(dtype=ti.i32, ndim=3)


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
    found: i32_3,  # (N, 3, 2): for both ranks the digits so far, the rank left; the largest bits
):
    for n in range(found.shape[0]):
        for i in range(2):
            found[n, i, 0] = 0
            found[n, i, 1] = ranks[i]
        found[n, 2, 0] = 0


@ti.kernel
def _count(
    dy: f32_3,
    dx: f32_3,
    norm: ti.i32,
    shift: ti.i32,
    width: ti.i32,
    zero: ti.i32,
    # outputs
    found: i32_3,
    counts: i32_3,  # (N, 2, BINS)
):
    for n, i, k in counts:
        counts[n, i, k] = 0
    for n, y, x in dy:
        bits = _bits_of(dy[n, y, x], dx[n, y, x], norm, zero)
        digit = (bits >> shift) & ((1 << width) - 1)
        for i in ti.static(range(2)):
            if bits >> (shift + width) == found[n, i, 0]:
                ti.atomic_add(counts[n, i, digit], 1)
        if bits > found[n, 2, 0]:
            ti.atomic_max(found[n, 2, 0], bits)


@ti.kernel
def _choose(
    counts: i32_3,
    width: ti.i32,
    # outputs
    found: i32_3,
):
    for n, i in ti.ndrange(found.shape[0], 2):
        rank = found[n, i, 1]
        below = 0
        digit = 0
        passed = 0
        for k in range(1 << width):
            below += counts[n, i, k]
            if below <= rank:
                digit = k + 1
                passed = below
        found[n, i, 0] = (found[n, i, 0] << width) | digit
        found[n, i, 1] = rank - passed


@ti.kernel
def _finish(
    found: i32_3,
    norm: ti.i32,
    strict: ti.i32,
    share: ti.f32,
    # outputs
    limits: f32_1,  # (2 N,)
):
    for n, i in ti.ndrange(found.shape[0], 2):
        bits = found[n, i, 0]
        if strict == 0:
            bits = ti.max(bits - 1, 0)
        least = 0.0
        if share > 0.0:  # 0 times infinity would be NaN
            least = ti.bit_cast(found[n, 2, 0], ti.f32) * share
            if norm == Norm.L2:
                least = least * share
        limits[2 * n + i] = ti.max(ti.bit_cast(bits, ti.f32), least)


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
    """Find two order statistics of the length of each image's gradient; one thread per pixel."""
    planes = (1, *dy.shape)[-3:]
    down, along = dy.reshape(planes), dx.reshape(planes)
    found = scratch((planes[0], 3, 2), np.int32)
    counts = scratch((planes[0], 2, BINS), np.int32)
    _begin(ranks, found)
    for shift, width in DIGITS:
        _count(down, along, norm, shift, width, 0, found, counts)
        _choose(counts, width, found)
    _finish(found, norm, int(strict), share, limits)
