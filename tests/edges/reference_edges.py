"""Plain NumPy statements of the edge primitives, pixel by pixel."""

import numpy as np
import scipy.ndimage as ndi

from cvkern.kernels.codes.edges import Edge, Norm, Thinning

_EIGHT = np.ones((3, 3), int)


def _measure(dy, dx, norm):
    return abs(dx) + abs(dy) if norm == Norm.L1 else dx * dx + dy * dy


def thin(dy, dx, norm, rule, low, high):
    """Keep the maxima along the gradient, in the arithmetic of the dtype of `dy`."""
    m = np.pad(_measure(dy, dx, norm), 1)
    states = np.full(dy.shape, Edge.NONE, np.uint8)
    for y, x in np.argwhere(m[1:-1, 1:-1] > dy.dtype.type(low)):
        near = m[y : y + 3, x : x + 3]
        framed = rule == Thinning.FRAMED
        if framed and (min(y, x) == 0 or y == dy.shape[0] - 1 or x == dy.shape[1] - 1):
            continue
        if rule == Thinning.SECTORS:
            top = _tops_sector(near, dy[y, x], dx[y, x], norm)
        else:
            top = _tops_line(near, dy[y, x], dx[y, x], norm, framed)
        if top:
            states[y, x] = Edge.STRONG if near[1, 1] > dy.dtype.type(high) else Edge.WEAK
    return states


def _tops_sector(near, gy, gx, norm):
    here = near[1, 1]
    ax, ay = abs(gx), abs(gy) * 32768
    if ay < ax * 13573:
        return here > near[1, 0] and here >= near[1, 2]
    if ay > ax * 79109:
        return here > near[0, 1] and here >= near[2, 1]
    s = -1 if (gx < 0) != (gy < 0) else 1
    return here > near[0, 1 - s] and here > near[2, 1 + s]


def _tops_line(near, gy, gx, norm, framed):
    near = near if norm == Norm.L1 else np.sqrt(near)
    s = -1 if (gx < 0) != (gy < 0) else 1
    ax, ay = abs(gx), abs(gy)
    if ay > ax:
        back = near[0, 1] * (ay - ax) + near[0, 1 - s] * ax
        ahead = near[2, 1] * (ay - ax) + near[2, 1 + s] * ax
        here = near[1, 1] * ay
        return (here > back or (framed and here == back)) and here >= ahead
    back = near[1, 0] * (ax - ay) + near[1 - s, 0] * ay
    ahead = near[1, 2] * (ax - ay) + near[1 + s, 2] * ay
    here = near[1, 1] * ax
    return (here > back or (framed and here == back)) and here >= ahead


def hysteresis(states):
    """Keep the components that hold a strong pixel."""
    labels = np.zeros(states.shape, np.int32)
    ndi.label(states != Edge.NONE, _EIGHT, output=labels)
    return np.isin(labels, np.unique(labels[states == Edge.STRONG])) & (labels > 0)


def subpixel_edges(dy, dx, mask):
    """Accepted pixels (N, 2), their points (N, 2), and the factor of 2^-24 that offsets may be off.

    With the logarithms p and q of the lengths before and after by the one here, the derivatives of
    ``(p - q) / (2 (p + q))`` are below ``1 / |p + q|``. Either is off by 1 + 4 |p| times 2^-24, by
    the rounding of the ratio and of the series.
    """
    m = np.pad(_measure(dy, dx, Norm.L2), 1)
    pixels, points, magnified = [], [], []
    for y, x in np.argwhere(mask):
        near = m[y : y + 3, x : x + 3]
        along_rows = abs(dy[y, x]) > abs(dx[y, x])
        before, here, after = (near[:, 1] if along_rows else near[1, :]).tolist()
        if 0 < before < here >= after > 0:
            p, q = np.log(np.array([before, after], np.float64) / here)
            offset = 0.5 * (p - q) / (p + q)
            pixels.append((y, x))
            points.append((y + offset, x) if along_rows else (y, x + offset))
            magnified.append(2 / abs(p + q) + 4)
    n = len(pixels)
    return np.array(pixels, int).reshape(n, 2), np.array(points).reshape(n, 2), np.array(magnified)
