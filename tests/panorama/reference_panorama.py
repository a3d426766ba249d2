"""Panoramas in NumPy and SciPy: directions, weights, samples, bands, seams."""

import heapq

import numpy as np
import scipy.ndimage as ndi

from cvkern.kernels.codes.panorama import FAR, OUTSIDE

F32 = np.float32


def places(matrix, columns, rows, lens, side):
    """Return x, y and depth of the pixels of a surface in an image, (3, h, w)."""
    a, b = columns.T
    p, q = rows.T
    rays = np.stack((a * p[:, None], np.broadcast_to(q[:, None], (len(p), len(a))), b * p[:, None]))
    there = np.einsum("ij,jhw->ihw", matrix, rays)
    depth = np.maximum(there[2], 1e-9)
    middle = (np.array(side)[::-1, None, None] - 1) / 2
    p = there[:2] / depth - middle
    bent = lens * (p**2).sum(axis=0)
    ahead = 1 + 3 * bent > 0  # else the lens would turn back
    return np.stack((*(middle + p * np.where(ahead, 1 + bent, 1)), np.where(ahead, there[2], -1)))


def weights(at, height, width):
    across = 1 - np.abs(2 * (at[0] + 0.5) / width - 1)
    down = 1 - np.abs(2 * (at[1] + 0.5) / height - 1)
    return np.where((at[2] > 1e-9) & (across > 0) & (down > 0), across * down, 0)


def samples(image, at, gains):
    """Return planes (C, h, w): linear between pixels, the rim repeated."""
    where = np.stack((at[1], at[0])).clip(-1e6, 1e6)  # SciPy takes it to an integer
    return np.stack(
        [
            g * ndi.map_coordinates(image[..., c].astype(float), where, order=1, mode="nearest")
            for c, g in enumerate(gains)
        ]
    )


def reduced(planes):
    """Return planes smoothed, of every second row and column."""
    taps = np.array([1, 4, 6, 4, 1]) / 16
    for axis in (1, 2):
        planes = ndi.correlate1d(planes.astype(float), taps, axis, mode="nearest")
    return planes[:, ::2, ::2]


def enlarged(planes):
    """Return planes at twice their size: zeros between the pixels, smoothed, times 4."""
    wide = np.pad(planes.astype(float), ((0, 0), (1, 1), (1, 1)), mode="edge")
    spread = np.zeros((len(wide), 2 * wide.shape[1], 2 * wide.shape[2]))
    spread[:, ::2, ::2] = wide
    taps = np.array([1, 4, 6, 4, 1]) / 8
    for axis in (1, 2):
        spread = ndi.correlate1d(spread, taps, axis, mode="constant")
    return spread[:, 2:-2, 2:-2]


def distances(costs, rect, starts):
    """Dijkstra's shortest ways over eight neighbours, from where `starts` (h, w) is 0."""
    found = starts.astype(np.int64).copy()
    queue = [(0, *map(int, place)) for place in np.argwhere(starts == 0)]
    while queue:
        length, i, j = heapq.heappop(queue)
        if length > found[i, j]:
            continue
        for s in (-1, 0, 1):
            for t in (-1, 0, 1):
                u, v = i + s, j + t
                if not (0 <= u < found.shape[0] and 0 <= v < found.shape[1]):
                    continue
                if found[u, v] == OUTSIDE:
                    continue
                cost = costs[u + rect[1], (v + rect[0]) % costs.shape[1]]
                new = length + int(cost) * (3 if s and t else 2)
                if new < found[u, v]:
                    found[u, v] = new
                    heapq.heappush(queue, (new, u, v))
    assert found.max() <= FAR
    return found


def on_canvas(rect, shape):
    """Return rows (h, 1) and columns (1, w) of the canvas of an image's pixels."""
    return np.arange(rect[1], rect[3])[:, None], np.arange(rect[0], rect[2])[None] % shape[1]
