"""Votes for ellipses in Taichi: one thread per pair of points.

A pair is taken as the ends of a major axis, and every third point votes for a minor semi-axis (Xie
and Ji, "A new efficient ellipse detection method", ICPR 2002).
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.hough import EllipseBounds
from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi._rounding import product, quotient, root

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
i32_3 = ti.types.ndarray(dtype=ti.i32, ndim=3)

_MEMORY = 1 << 24  # counts in the histograms that are filled at a time


@ti.func
def _dot(ay: ti.f32, by: ti.f32, ax: ti.f32, bx: ti.f32, zero: ti.i32) -> ti.f32:
    return product(ay, by, zero) + product(ax, bx, zero)


@ti.func
def _points_along(
    points: ti.template(), i: ti.i32, ey: ti.f32, ex: ti.f32, limit: ti.f32, zero: ti.i32
) -> ti.i32:
    """Tell whether a point's direction is that of (ey, ex) or its opposite, within `limit`."""
    cross = product(points[2, i], ex, zero) - product(points[3, i], ey, zero)
    return product(cross, cross, zero) <= limit


@ti.func
def _bin(
    points: ti.template(),
    i: ti.i32,
    j: ti.i32,
    k: ti.i32,
    narrow: ti.f32,
    wide: ti.f32,
    per_bin: ti.f32,
    turn: ti.f32,
    zero: ti.i32,
) -> ti.i32:
    """Return the bin that point `k` votes for, or -1; the arithmetic is that of the Warp set."""
    found = -1
    ey = points[0, j] - points[0, i]
    ex = points[1, j] - points[1, i]
    whole = _dot(ey, ey, ex, ex, zero)
    py = (points[0, k] + points[0, k]) - (points[0, j] + points[0, i])
    px = (points[1, k] + points[1, k]) - (points[1, j] + points[1, i])
    p = _dot(py, ey, px, ex, zero)
    q = product(py, ex, zero) - product(px, ey, zero)
    if whole > p and whole + p > 0.0 and _dot(py, py, px, px, zero) <= whole:
        quarter = 0.25 * whole
        above = product(product(q, q, zero), quarter, zero)
        square = quotient(above, product(whole - p, whole + p, zero), zero)
        counts = square >= narrow and square <= wide
        if turn >= 0.0:
            u = product(square, p, zero)
            v = product(quarter, q, zero)
            gy = product(u, ey, zero) + product(v, ex, zero)
            gx = product(u, ex, zero) - product(v, ey, zero)
            limit = product(turn, _dot(gy, gy, gx, gx, zero), zero)
            counts = counts and _points_along(points, k, gy, gx, limit, zero)
        if counts:
            found = ti.cast(product(root(square, zero), per_bin, zero) + 0.5, ti.i32)
    return found


@ti.kernel
def _vote_pairs(
    points: f32_2,
    first: ti.i32,
    least: ti.f32,
    most: ti.f32,
    narrow: ti.f32,
    wide: ti.f32,
    per_bin: ti.f32,
    turn: ti.f32,
    zero: ti.i32,
    # scratch
    histograms: i32_3,
    # outputs
    votes: i32_2,
    axes: i32_2,
):
    for r, j in ti.ndrange(histograms.shape[0], points.shape[1]):
        i = first + r
        if i < points.shape[1]:
            ey = points[0, j] - points[0, i]
            ex = points[1, j] - points[1, i]
            whole = _dot(ey, ey, ex, ex, zero)
            paired = j < i and whole >= least and whole <= most
            if turn >= 0.0:
                limit = product(turn, whole, zero)
                paired = paired and _points_along(points, i, ey, ex, limit, zero)
                paired = paired and _points_along(points, j, ey, ex, limit, zero)
            best = 0
            at = 0
            if paired:
                for b in range(histograms.shape[2]):
                    histograms[r, j, b] = 0
                for k in range(points.shape[1]):
                    b = _bin(points, i, j, k, narrow, wide, per_bin, turn, zero)
                    if b >= 0:
                        histograms[r, j, b] += 1
                for b in range(histograms.shape[2]):
                    if histograms[r, j, b] > best:
                        best = histograms[r, j, b]
                        at = b
            votes[i, j] = best
            axes[i, j] = at


@primitive
def vote_pairs(
    points: np.ndarray,
    bounds: EllipseBounds,
    bins: int,
    votes: np.ndarray,
    axes: np.ndarray,
) -> None:
    """Find, for each pair of points, the minor semi-axis that most third points agree on."""
    count = points.shape[1]
    rows = max(1, min(count, _MEMORY // (count * bins)))
    histograms = scratch((rows, count, bins), np.int32)
    for first in range(0, count, rows):
        _vote_pairs(points, first, *bounds, 0, histograms, votes, axes)
