"""Sums of matching costs over windows: down the columns first, then along the rows.

The work is done in strips of rows, so that the sums between the two passes stay small.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.stereo import Cost
from cvkern.kernels.taichi._launch import scratch
from cvkern.kernels.taichi._rounding import product

any_3 = ti.types.ndarray(ndim=3)  # u8, u16, i32, f32 or u64

_STRIP_SUMS = 1 << 24  # number of sums of a strip


@ti.func
def inside(i: ti.i32, n: ti.i32) -> ti.i32:
    """Return the index in [0, n) nearest to `i`."""
    return ti.math.clamp(i, 0, n - 1)


@ti.func
def ones(word: ti.u64) -> ti.i32:
    """Count the set bits: per pair, per four, per byte; a product adds the bytes."""
    w = word
    w = w - ((w >> ti.u64(1)) & ti.u64(0x5555555555555555))  # Vulkan has no "-=" of 64 bits
    w = (w & ti.u64(0x3333333333333333)) + ((w >> ti.u64(2)) & ti.u64(0x3333333333333333))
    w = (w + (w >> ti.u64(4))) & ti.u64(0x0F0F0F0F0F0F0F0F)
    return ti.cast((w * ti.u64(0x0101010101010101)) >> ti.u64(56), ti.i32)


@ti.func
def _half(total: ti.template(), floats: ti.template()):
    """Return half of a sum of two values; integers are rounded down."""
    half = total
    if ti.static(floats):
        half = total * 0.5
    else:
        half = total >> 1
    return half


@ti.func
def _range(image: ti.template(), y: ti.i32, x: ti.i32, c: ti.i32, floats: ti.template()):
    """Return a value, and the smallest and largest value within half a pixel of it."""
    last = image.shape[1]
    here = image[y, inside(x, last), c] + 0  # bytes become int32
    before = _half(image[y, inside(x - 1, last), c] + here, floats)
    behind = _half(here + image[y, inside(x + 1, last), c], floats)
    least = ti.min(here, ti.min(before, behind))
    return here, least, ti.max(here, ti.max(before, behind))


@ti.func
def _dissimilarity(
    left: ti.template(),
    right: ti.template(),
    y: ti.i32,
    x: ti.i32,
    partner: ti.i32,
    c: ti.i32,
    floats: ti.template(),
):
    """Return Birchfield and Tomasi's measure of two values."""
    a, a_low, a_high = _range(left, y, x, c, floats)
    b, b_low, b_high = _range(right, y, partner, c, floats)
    one = ti.max(ti.max(a, b_high) - b_high, ti.max(a, b_low) - a)
    return ti.min(one, ti.max(ti.max(b, a_high) - a_high, ti.max(b, a_low) - b))


@ti.kernel
def _sum_down(
    left: any_3,  # (H, W, C)
    right: any_3,  # (H, W, C)
    first: ti.i32,
    cost: ti.template(),
    floats: ti.template(),
    radius_y: ti.i32,
    radius_x: ti.i32,
    top: ti.i32,
    zero: ti.i32,
    # outputs
    sums: any_3,  # (rows of the strip, W + 2 radius_x, D)
):
    for i, j, k in sums:
        x = j - radius_x
        partner = inside(x - first - k, right.shape[1])
        if ti.static(cost == Cost.BIRCHFIELD_TOMASI):
            partner = x - first - k  # it has neighbours outside the image
        else:
            x = inside(x, left.shape[1])
        sums[i, j, k] = 0
        nothing = sums[i, j, k]  # in the type of the sums
        down = nothing
        for v in range(top + i - radius_y, top + i + radius_y + 1):
            y = inside(v, left.shape[0])
            total = nothing
            for c in range(left.shape[2]):
                if ti.static(cost == Cost.CENSUS):
                    total += ones(left[y, x, c] ^ right[y, partner, c])
                elif ti.static(cost == Cost.ZNCC and floats):  # exact in float64
                    a = ti.cast(left[y, x, c], ti.f64)
                    total += a * ti.cast(right[y, partner, c], ti.f64)
                elif ti.static(cost == Cost.ZNCC):
                    total += (left[y, x, c] + 0) * right[y, partner, c]
                elif ti.static(cost == Cost.BIRCHFIELD_TOMASI):
                    total += _dissimilarity(left, right, y, x, partner, c, floats)
                else:
                    d = ti.abs((left[y, x, c] + 0) - right[y, partner, c])
                    if ti.static(cost == Cost.SAD):
                        total += d
                    elif ti.static(floats):
                        total += product(d, d, zero)
                    else:
                        total += d * d
            down += total
        sums[i, j, k] = down


@ti.kernel
def _sum_along(
    sums: any_3,  # (rows of the strip, W + 2 radius_x, D)
    radius_x: ti.i32,
    # outputs
    costs: any_3,  # (rows of the strip, W, D)
):
    for i, x, k in costs:
        total = sums[i, x, k]
        for u in range(1, 2 * radius_x + 1):
            total += sums[i, x + u, k]
        costs[i, x, k] = total


def sum_windows(
    left: np.ndarray,
    right: np.ndarray,
    first: int,
    cost: int,
    radius_y: int,
    radius_x: int,
    top: int,
    costs: np.ndarray,
) -> None:
    """Sum a cost over the windows of the rows from `top` on; one thread per sum."""
    rows, width, depth = costs.shape
    floats = left.dtype == np.float32
    dtype = (np.float64 if cost == Cost.ZNCC else np.float32) if floats else np.int32
    strip = strip_rows(rows, (width + 2 * radius_x) * depth)
    for begin in range(0, rows, strip):
        part = costs[begin : begin + strip]
        sums = scratch((len(part), width + 2 * radius_x, depth), dtype)
        at = top + begin
        _sum_down(left, right, first, Cost(cost), floats, radius_y, radius_x, at, 0, sums)
        _sum_along(sums, radius_x, part)


def strip_rows(height: int, columns: int) -> int:
    """Return the number of rows of a strip, for rows with `columns` sums."""
    return max(1, min(height, _STRIP_SUMS // columns))
