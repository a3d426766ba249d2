"""From edge points to circles in Taichi: one thread per point, or per point and circle.

Each edge point has a line, given by its sub-pixel position and the direction of its gradient. Lines
vote for centres, in cells. Points near a centre vote for radii. The points near a circle give the
sums of a least-squares fit.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.hough import ARCS, FINE_ONE, LINE_ONE, NORMAL_ONE, Aim
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._rounding import product, quotient, root

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
i64_2 = ti.types.ndarray(dtype=ti.i64, ndim=2)
image_2 = ti.types.ndarray(ndim=2)  # uint8 or float32


@ti.kernel
def _shrink(
    src: image_2,
    factor: ti.i32,
    share: ti.f32,
    # outputs
    dst: f32_2,
):
    for y, x in dst:
        total = 0.0
        for u in range(factor):
            column = 0.0
            for v in range(factor):
                column += ti.cast(src[y * factor + v, x * factor + u], ti.f32)
            total += column
        dst[y, x] = total * share


@primitive
def shrink(src: np.ndarray, factor: int, dst: np.ndarray) -> None:
    """Average squares of `factor` x `factor` pixels of a uint8 or float32 image."""
    share = np.float32(1) / np.float32(factor * factor)
    _shrink(src, factor, share, dst)


@ti.func
def _length(dy: ti.template(), dx: ti.template(), y: ti.i32, x: ti.i32, zero: ti.i32) -> ti.f32:
    """Return the length of the gradient, 0 outside the image."""
    square = 0.0
    if 0 <= y < dy.shape[0] and 0 <= x < dy.shape[1]:
        square = product(dx[y, x], dx[y, x], zero) + product(dy[y, x], dy[y, x], zero)
    return root(square, zero)


@ti.kernel
def _aim(
    dy: f32_2,
    dx: f32_2,
    pixels: i32_2,
    zero: ti.i32,
    # outputs
    lines: f32_2,
):
    for i in range(lines.shape[1]):
        y = pixels[i, 0]
        x = pixels[i, 1]
        steep = 0
        if ti.abs(dy[y, x]) > ti.abs(dx[y, x]):
            steep = 1
        flat = 1 - steep
        before = _length(dy, dx, y - steep, x - flat, zero)
        here = _length(dy, dx, y, x, zero)
        behind = _length(dy, dx, y + steep, x + flat, zero)
        offset = 0.0
        if here > before and here >= behind:  # move to the maximum of a parabola through the three
            offset = quotient(0.5 * (before - behind), (before - 2.0 * here) + behind, zero)
        lines[0, i] = y + (offset if steep == 1 else 0.0)
        lines[1, i] = x + (0.0 if steep == 1 else offset)
        lines[2, i] = quotient(dy[y, x], here, zero)
        lines[3, i] = quotient(dx[y, x], here, zero)


@primitive
def aim(dy: np.ndarray, dx: np.ndarray, pixels: np.ndarray, lines: np.ndarray) -> None:
    """Write row, column, sine and cosine of direction of the sub-pixel edge at each of N pixels."""
    _aim(dy, dx, pixels, 0, lines)


@ti.kernel
def _vote_centers(
    lines: f32_2,
    low: ti.i32,
    high: ti.i32,
    scale: ti.f32,
    first_side: ti.i32,
    last_side: ti.i32,
    zero: ti.i32,
    # outputs
    votes: f32_2,
):
    for y, x in votes:
        votes[y, x] = 0.0
    for i in range(lines.shape[1]):
        y = ti.cast(ti.floor(product(lines[0, i], scale, zero) + 0.5), ti.i32) + LINE_ONE // 2
        x = ti.cast(ti.floor(product(lines[1, i], scale, zero) + 0.5), ti.i32) + LINE_ONE // 2
        dy = ti.cast(lines[2, i] * LINE_ONE, ti.i32)
        dx = ti.cast(lines[3, i] * LINE_ONE, ti.i32)
        for s in range((first_side - last_side) // 2 + 1):
            side = first_side - 2 * s
            for k in range(low, high + 1):
                row = (y + side * k * dy) >> ti.static(LINE_ONE.bit_length() - 1)
                column = (x + side * k * dx) >> ti.static(LINE_ONE.bit_length() - 1)
                if 0 <= row < votes.shape[0] and 0 <= column < votes.shape[1]:
                    ti.atomic_add(votes[row, column], 1.0)  # exact in any order


@primitive
def vote_centers(
    lines: np.ndarray,
    low: int,
    high: int,
    scale: float,
    first_side: int,
    last_side: int,
    votes: np.ndarray,
) -> None:
    """Count in each cell the lines that reach it after `low` to `high` steps; fill all votes."""
    _vote_centers(lines, low, high, scale, first_side, last_side, 0, votes)


@ti.func
def _seen(
    lines: ti.template(),
    i: ti.i32,
    cy: ti.f32,
    cx: ti.f32,
    slack: ti.f32,
    slope: ti.f32,
    first_side: ti.i32,
    last_side: ti.i32,
    zero: ti.i32,
) -> ti.f32:
    """Return the distance of point `i` from the centre if it aims at the centre; else -1."""
    dy = lines[0, i] - cy
    dx = lines[1, i] - cx
    d = root(product(dy, dy, zero) + product(dx, dx, zero), zero)
    aside = product(dy, lines[3, i], zero) - product(dx, lines[2, i], zero)
    ahead = product(dy, lines[2, i], zero) + product(dx, lines[3, i], zero)
    turned = (ahead < 0.0 and first_side > 0) or (ahead > 0.0 and last_side < 0)
    if not (turned and ti.abs(aside) <= slack + product(slope, d, zero)):
        d = -1.0
    return d


@ti.kernel
def _vote_radii(
    lines: f32_2,
    centers: f32_2,
    least: ti.f32,
    most: ti.f32,
    per_bin: ti.f32,
    slack: ti.f32,
    slope: ti.f32,
    first_side: ti.i32,
    last_side: ti.i32,
    zero: ti.i32,
    # outputs
    histograms: i32_2,
):
    for circle, b in histograms:
        histograms[circle, b] = 0
    for circle, i in ti.ndrange(centers.shape[0], lines.shape[1]):
        cy = centers[circle, 0]
        cx = centers[circle, 1]
        d = _seen(lines, i, cy, cx, slack, slope, first_side, last_side, zero)
        if least <= d <= most:
            b = ti.cast((d - least) * per_bin, ti.i32)
            if b < histograms.shape[1]:
                ti.atomic_add(histograms[circle, b], 1)


@primitive
def vote_radii(
    lines: np.ndarray,
    centers: np.ndarray,
    least: float,
    most: float,
    per_bin: float,
    aim: Aim,
    histograms: np.ndarray,
) -> None:
    """Count, by distance, the points that aim at each centre; fill all histograms."""
    _vote_radii(lines, centers, least, most, per_bin, *aim, 0, histograms)


@ti.kernel
def _support(
    lines: f32_2,
    circles: f32_2,
    band: ti.f32,
    slack: ti.f32,
    slope: ti.f32,
    first_side: ti.i32,
    last_side: ti.i32,
    zero: ti.i32,
    # outputs
    sums: i64_2,
    arcs: i32_2,
):
    for circle, k in sums:
        sums[circle, k] = ti.cast(0, ti.i64)
    for circle, k in arcs:
        arcs[circle, k] = 0
    for circle, i in ti.ndrange(circles.shape[0], lines.shape[1]):
        cy = circles[circle, 0]
        cx = circles[circle, 1]
        radius = circles[circle, 2]
        d = _seen(lines, i, cy, cx, slack, slope, first_side, last_side, zero)
        if d > 0.0 and radius - band <= d <= radius + band:
            dy = lines[0, i] - cy
            dx = lines[1, i] - cx
            ny = ti.cast(ti.floor(quotient(dy, d, zero) * NORMAL_ONE + 0.5), ti.i64)
            nx = ti.cast(ti.floor(quotient(dx, d, zero) * NORMAL_ONE + 0.5), ti.i64)
            e = ti.cast(ti.floor((d - radius) * FINE_ONE + 0.5), ti.i64)
            ti.atomic_add(sums[circle, 0], ny * ny)
            ti.atomic_add(sums[circle, 1], ny * nx)
            ti.atomic_add(sums[circle, 2], nx * nx)
            ti.atomic_add(sums[circle, 3], ny)
            ti.atomic_add(sums[circle, 4], nx)
            ti.atomic_add(sums[circle, 5], ti.cast(1, ti.i64))
            ti.atomic_add(sums[circle, 6], e * ny)
            ti.atomic_add(sums[circle, 7], e * nx)
            ti.atomic_add(sums[circle, 8], e)
            long = ti.max(ti.abs(dy), ti.abs(dx))
            short = ti.min(ti.abs(dy), ti.abs(dx))
            octant = 0
            if dy < 0.0:
                octant += 1
            if dx < 0.0:
                octant += 2
            if ti.abs(dy) > ti.abs(dx):
                octant += 4
            step = ti.cast(quotient(short, long, zero) * (ARCS // 8), ti.i32)
            ti.atomic_add(arcs[circle, octant * (ARCS // 8) + ti.min(step, ARCS // 8 - 1)], 1)


@primitive
def support(
    lines: np.ndarray,
    circles: np.ndarray,
    band: float,
    aim: Aim,
    sums: np.ndarray,
    arcs: np.ndarray,
) -> None:
    """Compute the sums of a least-squares fit for each circle, and count points by arc."""
    _support(lines, circles, band, *aim, 0, sums, arcs)
