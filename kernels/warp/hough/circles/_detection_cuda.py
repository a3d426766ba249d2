"""From edge points to circles on CUDA: one thread per point, or per point and circle.

Lines vote for centres, points near a centre vote for radii, and the points near a circle give the
sums of a least-squares fit; detection.py describes the steps.
"""

from typing import Any

import warp as wp

from cvkern.kernels.codes.hough import ARCS, FINE_ONE, LINE_ONE, NORMAL_ONE

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "default_grid_stride": False})

ONE = wp.constant(LINE_ONE)
BITS = wp.constant(LINE_ONE.bit_length() - 1)
NORMAL = wp.constant(float(NORMAL_ONE))
FINE = wp.constant(float(FINE_ONE))
STEPS = wp.constant(ARCS // 8)


def _shrink(scalar: Any) -> wp.Kernel:
    """Return the kernel for values of one type."""

    @wp.kernel
    def shrink(
        src: wp.array2d[scalar],  # (H, W)
        factor: int,
        # outputs
        dst: wp.array2d[float],  # (H // factor, W // factor)
    ):
        i = wp.tid()
        y = i // dst.shape[1]
        x = i - y * dst.shape[1]
        total = float(0.0)
        for u in range(factor):
            column = float(0.0)
            for v in range(factor):
                column += float(src[y * factor + v, x * factor + u])
            total += column
        dst[y, x] = total * (1.0 / float(factor * factor))

    return shrink


shrinks = {wp.uint8: _shrink(wp.uint8), wp.float32: _shrink(wp.float32)}


@wp.kernel
def clear(
    # outputs
    values: wp.array[float],
):
    values[wp.tid()] = 0.0


@wp.kernel
def clear_integers(
    # outputs
    values: wp.array[int],
):
    values[wp.tid()] = 0


@wp.kernel
def clear_sums(
    # outputs
    values: wp.array[wp.int64],
):
    values[wp.tid()] = wp.int64(0)


@wp.kernel
def vote_centers(
    lines: wp.array2d[float],  # (4, N)
    low: int,
    high: int,
    scale: float,
    first_side: int,
    last_side: int,
    # outputs
    votes: wp.array2d[float],  # (H, W)
):
    i = wp.tid()
    y = int(wp.floor(lines[0, i] * scale + 0.5)) + ONE // 2
    x = int(wp.floor(lines[1, i] * scale + 0.5)) + ONE // 2
    dy = int(lines[2, i] * float(ONE))
    dx = int(lines[3, i] * float(ONE))
    for s in range((first_side - last_side) // 2 + 1):
        side = first_side - 2 * s
        for k in range(low, high + 1):
            row = (y + side * k * dy) >> BITS
            column = (x + side * k * dx) >> BITS
            if row < 0 or column < 0 or row >= votes.shape[0] or column >= votes.shape[1]:
                break
            wp.atomic_add(votes, row, column, 1.0)  # exact below 2^24, in any order


@wp.func
def seen(
    lines: wp.array2d[float],
    i: int,
    cy: float,
    cx: float,
    slack: float,
    slope: float,
    first_side: int,
    last_side: int,
) -> float:
    """Return the distance of point `i` from the centre if it aims at the centre; else -1."""
    dy = lines[0, i] - cy
    dx = lines[1, i] - cx
    d = wp.sqrt(dy * dy + dx * dx)
    aside = dy * lines[3, i] - dx * lines[2, i]
    ahead = dy * lines[2, i] + dx * lines[3, i]
    turned = (ahead < 0.0 and first_side > 0) or (ahead > 0.0 and last_side < 0)
    if turned and wp.abs(aside) <= slack + slope * d:
        return d
    return -1.0


@wp.kernel
def vote_radii(
    lines: wp.array2d[float],  # (4, N)
    centers: wp.array2d[float],  # (K, 2)
    least: float,
    most: float,
    per_bin: float,
    slack: float,
    slope: float,
    first_side: int,
    last_side: int,
    # outputs
    histograms: wp.array2d[int],  # (K, bins)
):
    circle = wp.tid() // lines.shape[1]
    i = wp.tid() - circle * lines.shape[1]
    d = seen(lines, i, centers[circle, 0], centers[circle, 1], slack, slope, first_side, last_side)
    if d >= least and d <= most:
        b = int((d - least) * per_bin)
        if b < histograms.shape[1]:
            wp.atomic_add(histograms, circle, b, 1)


@wp.kernel
def support(
    lines: wp.array2d[float],  # (4, N)
    circles: wp.array2d[float],  # (K, 3)
    band: float,
    slack: float,
    slope: float,
    first_side: int,
    last_side: int,
    # outputs
    sums: wp.array2d[wp.int64],  # (K, 9)
    arcs: wp.array2d[int],  # (K, ARCS)
):
    circle = wp.tid() // lines.shape[1]
    i = wp.tid() - circle * lines.shape[1]
    cy = circles[circle, 0]
    cx = circles[circle, 1]
    radius = circles[circle, 2]
    d = seen(lines, i, cy, cx, slack, slope, first_side, last_side)
    if d <= 0.0 or d < radius - band or d > radius + band:
        return
    dy = lines[0, i] - cy
    dx = lines[1, i] - cx
    ny = wp.int64(wp.floor(dy / d * NORMAL + 0.5))
    nx = wp.int64(wp.floor(dx / d * NORMAL + 0.5))
    e = wp.int64(wp.floor((d - radius) * FINE + 0.5))
    wp.atomic_add(sums, circle, 0, ny * ny)
    wp.atomic_add(sums, circle, 1, ny * nx)
    wp.atomic_add(sums, circle, 2, nx * nx)
    wp.atomic_add(sums, circle, 3, ny)
    wp.atomic_add(sums, circle, 4, nx)
    wp.atomic_add(sums, circle, 5, wp.int64(1))
    wp.atomic_add(sums, circle, 6, e * ny)
    wp.atomic_add(sums, circle, 7, e * nx)
    wp.atomic_add(sums, circle, 8, e)
    steep = wp.abs(dy) > wp.abs(dx)
    slant = wp.where(steep, wp.abs(dx) / wp.abs(dy), wp.abs(dy) / wp.abs(dx))
    octant = wp.where(dy < 0.0, 1, 0) + wp.where(dx < 0.0, 2, 0) + wp.where(steep, 4, 0)
    step = wp.min(int(slant * float(STEPS)), STEPS - 1)
    wp.atomic_add(arcs, circle, octant * STEPS + step, 1)
