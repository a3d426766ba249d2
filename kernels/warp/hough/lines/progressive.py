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


@wp.func
def _begin(at: int, whole: bool) -> wp.int64:
    """Return where a line begins: the row or column, or its middle in units of 1 / STEPS."""
    return wp.where(whole, wp.int64(at), wp.int64(at) * _ONE + _HALF)


@wp.func
def _vote(
    y: int, x: int, turns: wp.array2d[wp.float64], threshold: int, votes: wp.array2d[int]
) -> int:
    """Add the votes of a point; return the line with the most of at least `threshold`, or -1."""
    most = threshold - 1
    best = int(-1)
    for angle in range(votes.shape[0]):
        place = _bin(turns, angle, y, x, votes.shape[1])
        count = votes[angle, place] + 1
        votes[angle, place] = count
        if count > most:
            most = count
            best = angle
    return best


@wp.func
def _last_point(
    y: int, x: int, down: int, along: int, flat: bool, line_gap: int, left: wp.array2d[wp.uint8]
) -> wp.vec2i:
    """Follow a line to one side, over gaps of up to `line_gap`; return its last point."""
    last = wp.vec2i(y, x)
    gap = int(0)
    at_y = _begin(y, not flat)
    at_x = _begin(x, flat)
    while gap <= line_gap:
        here_y = _pixel(at_y, not flat)
        here_x = _pixel(at_x, flat)
        if here_y < 0 or here_y >= left.shape[0] or here_x < 0 or here_x >= left.shape[1]:
            break
        gap += 1
        if left[here_y, here_x] != wp.uint8(0):
            gap = 0
            last = wp.vec2i(here_y, here_x)
        at_y += wp.int64(down)
        at_x += wp.int64(along)
    return last


@wp.func
def _take_away(
    y: int,
    x: int,
    down: int,
    along: int,
    flat: bool,
    last: wp.vec2i,
    turns: wp.array2d[wp.float64],
    # outputs
    left: wp.array2d[wp.uint8],
    votes: wp.array2d[int],
):
    """Remove the points of a line up to the last one, and their votes."""
    at_y = _begin(y, not flat)
    at_x = _begin(x, flat)
    walking = bool(True)
    while walking:
        here_y = _pixel(at_y, not flat)
        here_x = _pixel(at_x, flat)
        if left[here_y, here_x] != wp.uint8(0):
            left[here_y, here_x] = wp.uint8(0)
            for angle in range(votes.shape[0]):
                votes[angle, _bin(turns, angle, here_y, here_x, votes.shape[1])] -= 1
        walking = here_y != last[0] or here_x != last[1]
        at_y += wp.int64(down)
        at_x += wp.int64(along)


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
    found = int(0)
    for i in range(points.shape[0]):
        y = points[i, 0]
        x = points[i, 1]
        if left[y, x] == wp.uint8(0) or found == segments.shape[0]:
            continue
        best = _vote(y, x, turns, threshold, votes)
        if best < 0:
            continue
        # Along a flat line x changes by 1, along a steep one y, and the other by parts of it.
        down = steps[best, 0]
        along = steps[best, 1]
        flat = steps[best, 2] != 0
        one = _last_point(y, x, down, along, flat, line_gap, left)
        other = _last_point(y, x, -down, -along, flat, line_gap, left)
        if wp.max(wp.abs(other[0] - one[0]), wp.abs(other[1] - one[1])) < line_length:
            continue
        _take_away(y, x, down, along, flat, one, turns, left, votes)
        _take_away(y, x, -down, -along, flat, other, turns, left, votes)
        for k in range(2):
            segments[found, k] = one[k]
            segments[found, 2 + k] = other[k]
        found += 1
    number[0] = found
