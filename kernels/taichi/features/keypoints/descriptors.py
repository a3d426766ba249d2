"""Orientations and descriptors of keypoints in Taichi.

The gradients around a point vote for their directions in a histogram of 36 bins, each with its
length times a Gaussian weight of its distance. The bins are smoothed, and each peak of at least 0.8
of the highest gives the point an orientation, between bins by a parabola. The descriptor has
histograms of 8 directions in 4 x 4 cells of the window, turned by the orientation; a vote is shared
by linear weights among neighbouring cells and directions. The 128 numbers are normalised, cut off
at 0.2, and normalised again [D. G. Lowe, IJCV 60(2), 2004]; RootSIFT takes square roots of their
shares [R. Arandjelovic and A. Zisserman, CVPR 2012].

Histograms are sums of integers, so the order of the pixels has no effect. One thread takes a point.
"""

from collections.abc import Sequence

import numpy as np
import taichi as ti

from cvkern.kernels.codes.features import (
    BINS,
    BINS_PER_RADIAN,
    CELLS,
    DESCRIPTOR_ONE,
    DIRECTIONS,
    DIRECTIONS_PER_RADIAN,
    LARGEST_SHARE,
    LONGEST,
    PEAKS,
    ROOM,
    decay_factors,
)
from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi._polar import gradient_angle, squared_magnitude
from cvkern.kernels.taichi._rounding import product, root, wide_product

i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)

STEP = DIRECTIONS + 1
NUMBERS = CELLS * CELLS * DIRECTIONS


@ti.func
def _decay(x: ti.f32, zero: ti.i32) -> ti.f32:
    """exp(-x) for 0 <= x <= 8: a series for x / 16, squared four times."""
    y = x * 0.0625
    p = 1.0
    for factor in ti.static(decay_factors()):
        p = 1.0 - product(y * factor, p, zero)
    p = 1.0 - product(y, p, zero)
    for _ in ti.static(range(4)):
        p = p * p
    return p


@ti.func
def _gradient_at(levels: ti.template(), s: ti.i32, y: ti.i32, x: ti.i32, zero: ti.i32):
    """Return the length, cut off, and the angle of a gradient."""
    dx = levels[s, y, x + 1] - levels[s, y, x - 1]
    dy = levels[s, y + 1, x] - levels[s, y - 1, x]
    length = ti.min(root(squared_magnitude(dy, dx, zero), zero), LONGEST)
    return length, gradient_angle(dy, dx, zero)


@primitive
def orient(
    octaves: Sequence[np.ndarray],
    windows: np.ndarray,
    spreads: np.ndarray,
    one: float,
    angles: np.ndarray,
    counts: np.ndarray,
) -> None:
    """Find the directions of each point, in bins, by a histogram; a thread a point.

    A window is octave, level, row, column and radius; one of octave -1 has no directions.
    """
    sums = scratch((windows.shape[0], BINS), np.int32)
    for o, levels in enumerate(octaves):
        _orient(levels, o, windows, spreads, one, 0, sums)
    _pick(windows, sums, angles, counts)


@ti.func
def _smooth(sums: ti.template(), k: ti.i32, b: ti.i32) -> ti.i64:
    """Weigh five neighbouring bins by 1 4 6 4 1."""
    near = ti.cast(sums[k, (b + 1) % BINS], ti.i64) + sums[k, (b + BINS - 1) % BINS]
    far = ti.cast(sums[k, (b + 2) % BINS], ti.i64) + sums[k, (b + BINS - 2) % BINS]
    return far + 4 * near + 6 * ti.cast(sums[k, b], ti.i64)


@ti.kernel
def _orient(
    levels: f32_3,
    octave: ti.i32,
    windows: i32_2,  # (N, 5): octave, level, row, column, radius
    spreads: f32_1,
    one: ti.f32,
    zero: ti.i32,
    # outputs
    sums: i32_2,  # (N, BINS)
):
    for k in spreads:
        if windows[k, 0] != octave:
            continue
        s = windows[k, 1]
        cy = windows[k, 2]
        cx = windows[k, 3]
        radius = windows[k, 4]
        for b in range(BINS):
            sums[k, b] = 0
        for y in range(ti.max(cy - radius, 1), ti.min(cy + radius, levels.shape[1] - 2) + 1):
            down = _decay(product(ti.cast((y - cy) * (y - cy), ti.f32), spreads[k], zero), zero)
            for x in range(ti.max(cx - radius, 1), ti.min(cx + radius, levels.shape[2] - 2) + 1):
                squared = ti.cast((x - cx) * (x - cx), ti.f32)
                along = _decay(product(squared, spreads[k], zero), zero)
                length, angle = _gradient_at(levels, s, y, x, zero)
                bin = product(angle, BINS_PER_RADIAN, zero) + 0.5
                if bin < 0.0:
                    bin = bin + BINS
                b = ti.cast(bin, ti.i32)
                if b >= BINS:
                    b = b - BINS
                votes = product(product(length, product(down, along, zero), zero), one, zero)
                sums[k, b] = sums[k, b] + ti.cast(votes + 0.5, ti.i32)


@ti.kernel
def _pick(
    windows: i32_2,
    sums: i32_2,
    # outputs
    angles: f32_2,  # (N, PEAKS)
    counts: i32_1,
):
    for k in counts:
        counts[k] = 0
        if windows[k, 0] < 0:
            continue
        most = ti.cast(0, ti.i64)
        for b in range(BINS):
            most = ti.max(most, _smooth(sums, k, b))
        count = 0
        above = ti.cast(0, ti.i64)  # the last one taken, and its bin
        taken = -1
        for _ in range(PEAKS):
            best = -1
            high = ti.cast(-1, ti.i64)
            for b in range(BINS):
                v = _smooth(sums, k, b)
                left = _smooth(sums, k, (b + BINS - 1) % BINS)
                right = _smooth(sums, k, (b + 1) % BINS)
                peak = v > left and v > right and 5 * v >= 4 * most
                later = taken < 0 or v < above or (v == above and b > taken)
                if peak and later and v > high:
                    best = b
                    high = v
            if best >= 0:
                left = _smooth(sums, k, (best + BINS - 1) % BINS)
                right = _smooth(sums, k, (best + 1) % BINS)
                off = ti.cast(left - right, ti.f64) / ti.cast(left - 2 * high + right, ti.f64)
                angles[k, count] = ti.cast(ti.cast(best, ti.f64) + 0.5 * off, ti.f32)
                count += 1
                taken = best
                above = high
        counts[k] = count


@primitive
def describe(
    octaves: Sequence[np.ndarray],
    windows: np.ndarray,
    turns: np.ndarray,
    one: float,
    root: int,
    descriptors: np.ndarray,
) -> None:
    """Describe each point by histograms of directions in 16 cells; a thread a point."""
    sums = scratch((windows.shape[0], ROOM), np.int32)
    for o, levels in enumerate(octaves):
        _vote(levels, o, windows, turns, one, 0, sums)
    _normalise(sums, root, 0, descriptors)


@ti.func
def _add_both(sums: ti.template(), k: ti.i32, at: ti.i32, v: ti.f32, fd: ti.f32, zero: ti.i32):
    """Share a contribution between two directions."""
    w = product(v, fd, zero)
    sums[k, at] = sums[k, at] + ti.cast((v - w) + 0.5, ti.i32)
    sums[k, at + 1] = sums[k, at + 1] + ti.cast(w + 0.5, ti.i32)


@ti.kernel
def _vote(
    levels: f32_3,
    octave: ti.i32,
    windows: i32_2,
    turns: f32_2,  # (N, 4): cosine and sine over a cell's side, angle, spread
    one: ti.f32,
    zero: ti.i32,
    # outputs
    sums: i32_2,  # (N, ROOM)
):
    for k in range(windows.shape[0]):
        if windows[k, 0] != octave:
            continue
        s = windows[k, 1]
        cy = windows[k, 2]
        cx = windows[k, 3]
        radius = windows[k, 4]
        for n in range(ROOM):
            sums[k, n] = 0
        for y in range(ti.max(cy - radius, 1), ti.min(cy + radius, levels.shape[1] - 2) + 1):
            i = ti.cast(y - cy, ti.f32)
            row0 = product(i, turns[k, 0], zero)
            column0 = product(i, turns[k, 1], zero)
            down = _decay(product(i * i, turns[k, 3], zero), zero)
            for x in range(ti.max(cx - radius, 1), ti.min(cx + radius, levels.shape[2] - 2) + 1):
                j = ti.cast(x - cx, ti.f32)
                r = (row0 - product(j, turns[k, 1], zero)) + 1.5
                c = (column0 + product(j, turns[k, 0], zero)) + 1.5
                if r > -1.0 and r < CELLS and c > -1.0 and c < CELLS:
                    along = _decay(product(j * j, turns[k, 3], zero), zero)
                    length, angle = _gradient_at(levels, s, y, x, zero)
                    v = product(product(length, product(down, along, zero), zero), one, zero)
                    bin = product(angle - turns[k, 2], DIRECTIONS_PER_RADIAN, zero)
                    if bin < 0.0:
                        bin = bin + DIRECTIONS
                    if bin >= DIRECTIONS:
                        bin = bin - DIRECTIONS
                    r0 = ti.cast(r + 1.0, ti.i32)
                    c0 = ti.cast(c + 1.0, ti.i32)
                    o0 = ti.cast(bin, ti.i32)
                    fr = (r + 1.0) - ti.cast(r0, ti.f32)
                    fc = (c + 1.0) - ti.cast(c0, ti.f32)
                    fd = bin - ti.cast(o0, ti.f32)
                    v1 = product(v, fr, zero)
                    v0 = v - v1
                    v11 = product(v1, fc, zero)
                    v01 = product(v0, fc, zero)
                    at = (r0 * (CELLS + 2) + c0) * STEP + o0
                    under = at + (CELLS + 2) * STEP
                    _add_both(sums, k, at, v0 - v01, fd, zero)
                    _add_both(sums, k, at + STEP, v01, fd, zero)
                    _add_both(sums, k, under, v1 - v11, fd, zero)
                    _add_both(sums, k, under + STEP, v11, fd, zero)


@ti.func
def _bin_of(sums: ti.template(), k: ti.i32, n: ti.i32) -> ti.f64:
    """Return number `n` of a descriptor before it is normalised."""
    o = n % DIRECTIONS
    c = n // DIRECTIONS % CELLS
    r = n // DIRECTIONS // CELLS
    at = ((r + 1) * (CELLS + 2) + c + 1) * STEP
    v = sums[k, at + o]
    if o == 0:
        v += sums[k, at + DIRECTIONS]
    return ti.cast(v, ti.f64)


@ti.kernel
def _normalise(
    sums: i32_2,
    root: ti.i32,
    zero: ti.i32,
    # outputs
    descriptors: u8_2,  # (N, 128)
):
    for k in range(descriptors.shape[0]):
        squares = ti.cast(0.0, ti.f64)
        for n in range(NUMBERS):
            v = _bin_of(sums, k, n)
            squares = squares + wide_product(v, v, zero)
        most = wide_product(ti.f64(LARGEST_SHARE), ti.sqrt(squares), zero)
        total = ti.cast(0.0, ti.f64)
        for n in range(NUMBERS):
            v = ti.min(_bin_of(sums, k, n), most)
            if root == 0:
                v = wide_product(v, v, zero)
            total = total + v
        size = total
        if root == 0:
            size = ti.sqrt(total)
        for n in range(NUMBERS):
            share = ti.cast(0.0, ti.f64)
            if size > 0.0:
                share = ti.min(_bin_of(sums, k, n), most) / size
            if root == 1:
                share = ti.sqrt(share)
            share = ti.min(wide_product(DESCRIPTOR_ONE, share, zero) + 0.5, 255.0)
            descriptors[k, n] = ti.cast(ti.cast(share, ti.i32), ti.u8)
