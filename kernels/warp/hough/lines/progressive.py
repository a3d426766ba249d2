"""The progressive probabilistic Hough transform of lines, in Warp: one thread in all.

Each point depends on those before it. The Taichi set describes the steps.
"""

import warp as wp

from cvkern.kernels.codes.hough import STEPS, SegmentRule
from cvkern.kernels.warp._launch import launch

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_ONE = wp.constant(wp.int64(STEPS))
_HALF = wp.constant(wp.int64(STEPS // 2))


def follow(
    points: wp.array,
    turns: wp.array,
    steps: wp.array,
    rule: SegmentRule,
    left: wp.array,
    votes: wp.array,
    segments: wp.array,
    number: wp.array,
) -> None:
    """Fill the ends (row, column, row, column) of segments, and how many there are.

    `points` (N, 2) vote in their order for the cosines and sines `turns` (T, 2); `steps` (T, 3) are
    the steps along each line, down and to the right, and whether it is flat. The mask `left` has
    the points set, and `votes` (T, bins) and `number` are 0.
    """
    launch(_follow, 1, [points, turns, steps, *rule], [left, votes, segments, number])


@wp.func
def _bin(turns: wp.array2d[wp.float64], angle: int, y: int, x: int, bins: int) -> int:
    """Return the bin of the distance ``x cos + y sin``, rounded half away from 0."""
    rho = turns[angle, 0] * wp.float64(x) + turns[angle, 1] * wp.float64(y)
    half = wp.where(rho > wp.float64(0.0), wp.float64(0.5), wp.float64(-0.5))
    return int(rho + half) + bins // 2


@wp.func
def _pixel(at: wp.int64, whole: bool) -> int:
    """Return the row or column of a place, in pixels or in units of 1 / STEPS."""
    return int(at if whole else at // _ONE)


@wp.kernel
def _follow(
    points: wp.array2d[int],
    turns: wp.array2d[wp.float64],
    steps: wp.array2d[int],
    threshold: int,
    line_length: int,
    line_gap: int,
    # outputs
    left: wp.array2d[wp.uint8],
    votes: wp.array2d[int],
    segments: wp.array2d[int],
    number: wp.array[int],
):
    angles = votes.shape[0]
    bins = votes.shape[1]
    ends = wp.vec4i()
    found = int(0)
    for i in range(points.shape[0]):
        y = points[i, 0]
        x = points[i, 1]
        if left[y, x] == wp.uint8(0) or found == segments.shape[0]:
            continue
        most = threshold - 1
        best = int(-1)
        for angle in range(angles):
            place = _bin(turns, angle, y, x, bins)
            count = votes[angle, place] + 1
            votes[angle, place] = count
            if count > most:
                most = count
                best = angle
        if best < 0:
            continue

        # Along a flat line x changes by 1, along a steep one y, and the other by parts of it.
        flat = steps[best, 2] != 0
        start_y = wp.int64(y)
        start_x = wp.int64(x)
        if flat:
            start_y = start_y * _ONE + _HALF
        else:
            start_x = start_x * _ONE + _HALF
        for side in range(2):
            ends[2 * side] = y
            ends[2 * side + 1] = x
            gap = int(0)
            at_y = start_y
            at_x = start_x
            while gap <= line_gap:
                here_y = _pixel(at_y, not flat)
                here_x = _pixel(at_x, flat)
                if here_y < 0 or here_y >= left.shape[0] or here_x < 0 or here_x >= left.shape[1]:
                    break
                gap += 1
                if left[here_y, here_x] != wp.uint8(0):
                    gap = 0
                    ends[2 * side] = here_y
                    ends[2 * side + 1] = here_x
                at_y += wp.int64(steps[best, 0] * (1 - 2 * side))
                at_x += wp.int64(steps[best, 1] * (1 - 2 * side))
        if wp.max(wp.abs(ends[2] - ends[0]), wp.abs(ends[3] - ends[1])) < line_length:
            continue

        for side in range(2):
            at_y = start_y
            at_x = start_x
            walking = bool(True)
            while walking:
                here_y = _pixel(at_y, not flat)
                here_x = _pixel(at_x, flat)
                if left[here_y, here_x] != wp.uint8(0):
                    left[here_y, here_x] = wp.uint8(0)
                    for angle in range(angles):
                        votes[angle, _bin(turns, angle, here_y, here_x, bins)] -= 1
                walking = here_y != ends[2 * side] or here_x != ends[2 * side + 1]
                at_y += wp.int64(steps[best, 0] * (1 - 2 * side))
                at_x += wp.int64(steps[best, 1] * (1 - 2 * side))
        for k in range(4):
            segments[found, k] = ends[k]
        found += 1
    number[0] = found
