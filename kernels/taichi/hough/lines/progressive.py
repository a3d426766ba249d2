"""The progressive probabilistic Hough transform of lines, in Taichi: one thread in all.

Points vote one after another, in a random order. As soon as a line through the point has enough
votes, its pixels are followed to both sides of the point, over short gaps. If they reach far, they
are a segment: their votes and they themselves are taken away, so that they make no second one.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.hough import STEPS, SegmentRule
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._rounding import wide_product

f64_2 = ti.types.ndarray(dtype=ti.f64, ndim=2)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)


@ti.func
def _bin(turns: ti.template(), angle: ti.i32, y: ti.i32, x: ti.i32, bins: ti.i32, zero: ti.i32):
    """Return the bin of the distance ``x cos + y sin``, rounded half away from 0."""
    rho = wide_product(turns[angle, 0], ti.cast(x, ti.f64), zero)
    rho += wide_product(turns[angle, 1], ti.cast(y, ti.f64), zero)
    half = 0.5 if rho > 0.0 else -0.5
    return ti.cast(rho + half, ti.i32) + bins // 2


@ti.func
def _begin(at: ti.i32, whole: ti.i32) -> ti.i64:
    """Return where a line begins: the row or column, or its middle in units of 1 / STEPS."""
    place = ti.cast(at, ti.i64)
    if not whole:
        place = place * STEPS + STEPS // 2
    return place


@ti.func
def _pixel(at: ti.i64, whole: ti.i32) -> ti.i32:
    """Return the row or column of a place, in pixels or in units of 1 / STEPS."""
    return ti.cast(at if whole else at // STEPS, ti.i32)


@ti.func
def _vote(
    y: ti.i32,
    x: ti.i32,
    turns: ti.template(),
    threshold: ti.i32,
    zero: ti.i32,
    votes: ti.template(),
) -> ti.i32:
    """Add the votes of a point; return the line with the most of at least `threshold`, or -1."""
    most = threshold - 1
    best = -1
    for angle in range(votes.shape[0]):
        place = _bin(turns, angle, y, x, votes.shape[1], zero)
        votes[angle, place] += 1
        if votes[angle, place] > most:
            most = votes[angle, place]
            best = angle
    return best


@ti.func
def _last_point(
    y: ti.i32,
    x: ti.i32,
    down: ti.i32,
    along: ti.i32,
    flat: ti.i32,
    line_gap: ti.i32,
    left: ti.template(),
) -> ti.math.ivec2:
    """Follow a line to one side, over gaps of up to `line_gap`; return its last point."""
    last = ti.Vector([y, x])
    gap = 0
    at_y = _begin(y, not flat)
    at_x = _begin(x, flat)
    while gap <= line_gap:
        here_y = _pixel(at_y, not flat)
        here_x = _pixel(at_x, flat)
        inside = 0 <= here_y < left.shape[0] and 0 <= here_x < left.shape[1]
        if not inside:
            break
        gap += 1
        if left[here_y, here_x]:
            gap = 0
            last = ti.Vector([here_y, here_x])
        at_y += down
        at_x += along
    return last


@ti.func
def _take_away(
    y: ti.i32,
    x: ti.i32,
    down: ti.i32,
    along: ti.i32,
    flat: ti.i32,
    last: ti.math.ivec2,
    turns: ti.template(),
    zero: ti.i32,
    # outputs
    left: ti.template(),
    votes: ti.template(),
):
    """Remove the points of a line up to the last one, and their votes."""
    at_y = _begin(y, not flat)
    at_x = _begin(x, flat)
    while True:
        here_y = _pixel(at_y, not flat)
        here_x = _pixel(at_x, flat)
        if left[here_y, here_x]:
            left[here_y, here_x] = ti.cast(0, ti.u8)
            for angle in range(votes.shape[0]):
                votes[angle, _bin(turns, angle, here_y, here_x, votes.shape[1], zero)] -= 1
        if here_y == last[0] and here_x == last[1]:
            break
        at_y += down
        at_x += along


@ti.kernel
def _follow(
    points: i32_2,
    turns: f64_2,
    steps: i32_2,
    threshold: ti.i32,
    line_length: ti.i32,
    line_gap: ti.i32,
    zero: ti.i32,
    # outputs
    left: u8_2,
    votes: i32_2,
    segments: i32_2,
    number: i32_1,
):
    for _ in range(1):  # the outermost loop would be shared by threads
        for i in range(points.shape[0]):
            y = points[i, 0]
            x = points[i, 1]
            if left[y, x] == 0 or number[0] == segments.shape[0]:
                continue
            best = _vote(y, x, turns, threshold, zero, votes)
            if best < 0:
                continue
            # Along a flat line x changes by 1, along a steep one y, and the other by parts of it.
            down = steps[best, 0]
            along = steps[best, 1]
            flat = steps[best, 2]
            one = _last_point(y, x, down, along, flat, line_gap, left)
            other = _last_point(y, x, -down, -along, flat, line_gap, left)
            if ti.max(ti.abs(other[0] - one[0]), ti.abs(other[1] - one[1])) < line_length:
                continue
            _take_away(y, x, down, along, flat, one, turns, zero, left, votes)
            _take_away(y, x, -down, -along, flat, other, turns, zero, left, votes)
            for k in ti.static(range(2)):
                segments[number[0], k] = one[k]
                segments[number[0], 2 + k] = other[k]
            number[0] += 1


@primitive
def follow(
    points: np.ndarray,
    turns: np.ndarray,
    steps: np.ndarray,
    rule: SegmentRule,
    left: np.ndarray,
    votes: np.ndarray,
    segments: np.ndarray,
    number: np.ndarray,
) -> None:
    """Fill the ends (row, column, row, column) of segments, and how many there are.

    `points` (N, 2) vote in their order for the cosines and sines `turns` (T, 2); `steps` (T, 3) are
    the steps along each line, down and to the right, and whether it is flat. The mask `left` has
    the points set, and `votes` (T, bins) and `number` are 0.
    """
    _follow(points, turns, steps, *rule, 0, left, votes, segments, number)
