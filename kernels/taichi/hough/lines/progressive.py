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
    angles = votes.shape[0]
    bins = votes.shape[1]
    for _ in range(1):  # the outermost loop would be shared by threads
        for i in range(points.shape[0]):
            y = points[i, 0]
            x = points[i, 1]
            if left[y, x] == 0 or number[0] == segments.shape[0]:
                continue
            most = threshold - 1
            best = -1
            for angle in range(angles):
                place = _bin(turns, angle, y, x, bins, zero)
                votes[angle, place] += 1
                if votes[angle, place] > most:
                    most = votes[angle, place]
                    best = angle
            if best < 0:
                continue

            # Along a flat line x changes by 1, along a steep one y, and the other by parts of it.
            flat = steps[best, 2]
            start_y = ti.cast(y, ti.i64)
            start_x = ti.cast(x, ti.i64)
            if flat:
                start_y = start_y * STEPS + STEPS // 2
            else:
                start_x = start_x * STEPS + STEPS // 2
            ends = ti.Vector([y, x, y, x])
            for side in ti.static(range(2)):
                gap = 0
                at_y = start_y
                at_x = start_x
                while gap <= line_gap:
                    here_y = ti.cast(at_y // STEPS if flat else at_y, ti.i32)
                    here_x = ti.cast(at_x if flat else at_x // STEPS, ti.i32)
                    inside = 0 <= here_y < left.shape[0] and 0 <= here_x < left.shape[1]
                    if not inside:
                        break
                    gap += 1
                    if left[here_y, here_x]:
                        gap = 0
                        ends[2 * side] = here_y
                        ends[2 * side + 1] = here_x
                    at_y += steps[best, 0] * (1 - 2 * side)
                    at_x += steps[best, 1] * (1 - 2 * side)
            reach = ti.max(ti.abs(ends[2] - ends[0]), ti.abs(ends[3] - ends[1]))
            if reach < line_length:
                continue

            for side in ti.static(range(2)):
                at_y = start_y
                at_x = start_x
                while True:
                    here_y = ti.cast(at_y // STEPS if flat else at_y, ti.i32)
                    here_x = ti.cast(at_x if flat else at_x // STEPS, ti.i32)
                    if left[here_y, here_x]:
                        left[here_y, here_x] = ti.cast(0, ti.u8)
                        for angle in range(angles):
                            votes[angle, _bin(turns, angle, here_y, here_x, bins, zero)] -= 1
                    if here_y == ends[2 * side] and here_x == ends[2 * side + 1]:
                        break
                    at_y += steps[best, 0] * (1 - 2 * side)
                    at_x += steps[best, 1] * (1 - 2 * side)
            for k in ti.static(range(4)):
                segments[number[0], k] = ends[k]
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
