"""Detection of laser lines, one position in each column or row of a frame, in Taichi.

A line of light that crosses the columns has one position p in each. `find` takes the window of ``2
half + 1`` pixels with the largest sum, the first of equal ones. The other functions refine its
middle: `peaks` by a parabola, `centroids` by the centre of mass above the darkest pixel of a
window, `ridges` by the rule of C. Steger, "An unbiased detector of curvilinear structures",
PAMI 1998.

The parabola passes through the brightest value and its two neighbours. A saturated line has several
equal values; the parabola then passes through the values beside them, as if they were one pixel in
their middle.

Steger's rule takes the derivatives r of the Gaussian-smoothed frame at a pixel, and the eigenvector
n of their Hessian with the least eigenvalue e. The ridge is where the first derivative along n
vanishes. In the column this is at ``p + t`` with ``t = -(r_p + r_l n_l / n_p) / e``. The second
derivative of a Gaussian line falls off its ridge by the factor 1 - t^2 / s^2, where s^2 is the
variance of the smoothed profile; t is shortened accordingly. A position is accepted if it lies in
the pixel of the derivatives, or at most a quarter of a pixel beside it. The tolerance keeps noise
from trapping the search between two pixels.

With ``axis`` 0 positions are rows, one per column; with 1 columns, one per row. Frames are (N, H,
W). One thread computes one line.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.structured_light import LEAST_BEND, MOST_MOVES, MOST_OFFSET
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._rounding import product, quotient, root

any_3 = ti.types.ndarray(ndim=3)  # u8, u16 or f32
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)


@ti.func
def _value(
    frames: ti.template(), n: ti.i32, p: ti.i32, line: ti.i32, axis: ti.i32, size: ti.i32
) -> ti.f32:
    """Return the value at place `p` of a line; the ends are repeated."""
    at = ti.max(0, ti.min(size - 1, p))
    found = 0.0
    if axis == 0:
        found = ti.cast(frames[n, at, line], ti.f32)
    else:
        found = ti.cast(frames[n, line, at], ti.f32)
    return found


@ti.kernel
def _find(
    frames: any_3,
    axis: ti.i32,
    half: ti.i32,
    # outputs
    places: i32_2,  # (N, lines)
):
    size = frames.shape[1] if axis == 0 else frames.shape[2]
    for n, line in places:
        best = -ti.cast(ti.math.inf, ti.f32)
        place = -1
        for p in range(size):
            total = 0.0
            for i in range(-half, half + 1):
                total += _value(frames, n, p + i, line, axis, size)
            if total > best:
                best = total
                place = p
        places[n, line] = place


@primitive
def find(frames: np.ndarray, axis: int, half: int, places: np.ndarray) -> None:
    """Find the brightest window of each line, -1 where all is NaN; one thread a line."""
    _find(frames, axis, half, places)


@ti.kernel
def _peaks(
    frames: any_3,
    axis: ti.i32,
    places: i32_2,
    zero: ti.i32,
    # outputs
    positions: f32_2,
    strengths: f32_2,
):
    size = frames.shape[1] if axis == 0 else frames.shape[2]
    for n, line in places:
        p = places[n, line]
        position = ti.cast(ti.math.nan, ti.f32)
        strength = 0.0
        if p >= 0:
            a = _value(frames, n, p - 1, line, axis, size)
            b = _value(frames, n, p, line, axis, size)
            last = p
            c = _value(frames, n, last + 1, line, axis, size)
            while last < size - 1 and c == b:
                last += 1
                c = _value(frames, n, last + 1, line, axis, size)
            bend = (b - a) + (b - c)
            position = product(0.5, ti.cast(p + last, ti.f32), zero)
            if bend > 0.0:
                position += product(0.5, quotient(c - a, bend, zero), zero)
            strength = b
        positions[n, line] = position
        strengths[n, line] = strength


@primitive
def peaks(
    frames: np.ndarray, axis: int, places: np.ndarray, positions: np.ndarray, strengths: np.ndarray
) -> None:
    """Refine places, the first of equal values, by a parabola; the strength is the value there.

    One thread computes one line.
    """
    _peaks(frames, axis, places, 0, positions, strengths)


@ti.kernel
def _centroids(
    frames: any_3,
    axis: ti.i32,
    places: i32_2,
    radius: ti.i32,
    zero: ti.i32,
    # outputs
    positions: f32_2,
    strengths: f32_2,
):
    size = frames.shape[1] if axis == 0 else frames.shape[2]
    for n, line in places:
        p = places[n, line]
        position = ti.cast(ti.math.nan, ti.f32)
        strength = 0.0
        if p >= 0:
            first = ti.max(0, p - radius)
            last = ti.min(size - 1, p + radius)
            floor = _value(frames, n, first, line, axis, size)
            top = floor
            for i in range(first, last + 1):
                value = _value(frames, n, i, line, axis, size)
                floor = ti.min(floor, value)
                top = ti.max(top, value)
            mass = 0.0
            moment = 0.0
            for i in range(first, last + 1):
                weight = _value(frames, n, i, line, axis, size) - floor
                mass += weight
                moment += product(weight, ti.cast(i - p, ti.f32), zero)
            if mass > 0.0:
                position = ti.cast(p, ti.f32) + quotient(moment, mass, zero)
                strength = top - floor
        positions[n, line] = position
        strengths[n, line] = strength


@primitive
def centroids(
    frames: np.ndarray,
    axis: int,
    places: np.ndarray,
    radius: int,
    positions: np.ndarray,
    strengths: np.ndarray,
) -> None:
    """Refine places by the centre of mass of a window above its darkest pixel; one thread a line.

    The strength is the brightest value of the window less the darkest.
    """
    _centroids(frames, axis, places, radius, 0, positions, strengths)


@ti.kernel
def _ridges(
    frames: any_3,
    axis: ti.i32,
    places: i32_2,
    taps: f32_2,  # (3, 2 radius + 1): a Gaussian and its first two derivatives
    scale: ti.f32,
    curve: ti.f32,
    zero: ti.i32,
    # outputs
    positions: f32_2,
    strengths: f32_2,
):
    size = frames.shape[1] if axis == 0 else frames.shape[2]
    lines = places.shape[1]
    radius = taps.shape[1] // 2
    for n, line in places:
        p = places[n, line]
        position = ti.cast(ti.math.nan, ti.f32)
        strength = 0.0
        moves = 0
        while p >= 0 and moves < MOST_MOVES:
            rp, rl, rpp, rpl, rll = 0.0, 0.0, 0.0, 0.0, 0.0
            for i in range(-radius, radius + 1):
                a0, a1, a2 = 0.0, 0.0, 0.0
                for j in range(-radius, radius + 1):
                    beside = ti.max(0, ti.min(lines - 1, line + j))
                    value = _value(frames, n, p + i, beside, axis, size)
                    a0 += product(value, taps[0, j + radius], zero)
                    a1 += product(value, taps[1, j + radius], zero)
                    a2 += product(value, taps[2, j + radius], zero)
                rp += product(a0, taps[1, i + radius], zero)
                rl += product(a1, taps[0, i + radius], zero)
                rpp += product(a0, taps[2, i + radius], zero)
                rpl += product(a1, taps[1, i + radius], zero)
                rll += product(a2, taps[0, i + radius], zero)
            half = product(0.5, rpp - rll, zero)
            if ti.abs(half) < LEAST_BEND:
                half = 0.0
            if ti.abs(rpl) < LEAST_BEND:
                rpl = 0.0
            spread = root(product(half, half, zero) + product(rpl, rpl, zero), zero)
            least = product(0.5, rpp + rll, zero) - spread
            tilt = 0.0
            if half - spread < 0.0:
                tilt = quotient(rpl, half - spread, zero)
            moves += 1
            if not least < 0.0:
                break
            offset = -quotient(rp + product(rl, tilt, zero), least, zero)
            if ti.abs(offset) <= MOST_OFFSET:
                shorter = 1.0 - product(product(offset, offset, zero), curve, zero)
                position = ti.cast(p, ti.f32) + product(offset, shorter, zero)
                strength = product(scale, -least, zero)
                break
            step = ti.max(-1.0, ti.min(1.0, ti.floor(offset + 0.5)))
            p = ti.max(0, ti.min(size - 1, p + ti.cast(step, ti.i32)))
        positions[n, line] = position
        strengths[n, line] = strength


@primitive
def ridges(
    frames: np.ndarray,
    axis: int,
    places: np.ndarray,
    taps: np.ndarray,
    scale: float,
    curve: float,
    positions: np.ndarray,
    strengths: np.ndarray,
) -> None:
    """Refine places by Steger's rule, one thread a line; the strength is `scale` times the bend.

    `curve` is 1 over the variance of the smoothed profile.
    """
    _ridges(frames, axis, places, taps, scale, curve, 0, positions, strengths)


@ti.kernel
def _select(
    strengths: f32_2,
    threshold: ti.f32,
    # outputs
    positions: f32_2,
):
    for n, line in positions:
        if not strengths[n, line] >= threshold:
            positions[n, line] = ti.cast(ti.math.nan, ti.f32)


@primitive
def select(strengths: np.ndarray, threshold: float, positions: np.ndarray) -> None:
    """Make NaN of the positions of less strength than the threshold; one thread a line."""
    _select(strengths, threshold, positions)
