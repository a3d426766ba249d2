"""Semi-global aggregation and winner takes all, pixel by pixel, in wide integers and float64."""

import numpy as np

STRAIGHT = [(0, 1), (0, -1), (1, 0), (-1, 0)]
DIAGONAL = [(1, 1), (1, -1), (-1, 1), (-1, -1)]
KNIGHT = [(s * a, t * b) for a, b in ((1, 2), (2, 1)) for s in (1, -1) for t in (1, -1)]
DIRECTIONS = {4: STRAIGHT, 8: STRAIGHT + DIAGONAL, 16: STRAIGHT + DIAGONAL + KNIGHT}


def path_costs(costs, guide, p1, p2, dy, dx):
    """Return L of the paths that go by (dy, dx); `p2` is a table over differences of the guide."""
    height, width, _ = costs.shape
    lines = np.empty(costs.shape, np.int64)
    for y in range(height)[:: 1 if dy >= 0 else -1]:
        for x in range(width)[:: 1 if dx >= 0 else -1]:
            lines[y, x] = costs[y, x]
            if not (0 <= y - dy < height and 0 <= x - dx < width):
                continue
            before = lines[y - dy, x - dx]
            difference = 0
            if guide is not None:
                difference = abs(int(guide[y, x]) - int(guide[y - dy, x - dx]))
            ways = [before, np.full_like(before, before.min() + int(p2[difference]))]
            ways.append(np.append(before[1:], 2**40) + p1)
            ways.append(np.append(2**40, before[:-1]) + p1)
            lines[y, x] += np.min(ways, axis=0) - before.min()
    return lines


def aggregate(costs, guide, p1, p2, paths):
    """Return the sums over all directions."""
    return np.sum(
        [path_costs(costs, guide, p1, p2, dy, dx) for dy, dx in DIRECTIONS[paths]], axis=0
    )


def pick(costs, first, subpixel, uniqueness):
    """Return index, disparity, cost and confidence of each pixel, one by one."""
    shape = costs.shape[:2]
    depth = costs.shape[2]
    index = np.empty(shape, np.int32)
    disparity, cost, confidence = (np.empty(shape, np.float32) for _ in range(3))
    for p in np.ndindex(shape):
        # Float64 holds every integer cost, and float32 costs times a percentage, exactly.
        line = costs[p].astype(np.float64)
        k = int(np.argmin(line))
        least = line[k]
        far = line[np.abs(np.arange(depth) - k) > 1]
        rival = far.min() if far.size else np.inf
        offset = 0.0
        if 0 < k < depth - 1 and subpixel != "none":
            a, b = line[k - 1] - least, line[k + 1] - least
            m = a + b if subpixel == "parabola" else max(a, b)
            if 0 < m < np.inf:
                offset = 0.5 * (a - b) / m
        unique = uniqueness == 0 or rival * (100 - uniqueness) >= least * 100
        index[p] = k if unique else -1
        disparity[p] = first + k + offset if unique else np.nan
        cost[p] = least
        confidence[p] = 1 - least / rival if rival > least else 0
    return index, disparity, cost, confidence


def pick_right(costs, first):
    """Return the index of each pixel of the right image, -1 where no left pixel matches it."""
    height, width, depth = costs.shape
    index = np.full((height, width), -1, np.int32)
    for y, x in np.ndindex(height, width):
        best = np.inf
        for k in range(depth):
            left = x + first + k
            if 0 <= left < width and (index[y, x] < 0 or costs[y, left, k] < best):
                best, index[y, x] = costs[y, left, k], k
    return index
