"""Robust fits in NumPy: samples by a counter, models by linear solvers, costs in fixed point."""

import numpy as np

MASK = 2**32 - 1
GROUP, PREVIEW, COST_ONE, NO_COST, FLAT = 64, 64, 4096, 2**31 - 1, 1e-4
SIZES = (2, 3, 4, 7, 2)  # matches of a sample, by model


def mix(x):
    """PCG's output function [Jarzynski and Olano 2020], on Python's integers."""
    state = (x * 747796405 + 2891336453) & MASK
    word = (((state >> ((state >> 28) + 4)) ^ state) * 277803737) & MASK
    return (word >> 22) ^ word


def index(seed, hypothesis, which, count):
    x = mix((seed ^ (0x1E3779B9 * which)) & MASK)
    return mix((hypothesis + mix(x)) & MASK) * count >> 32


def sample(seed, hypothesis, count, size):
    """Return the matches of a hypothesis, or None; slot s may draw numbers s, s + 8, ..."""
    picked = []
    for slot in range(size):
        for n in range(16):
            drawn = index(seed, hypothesis, slot + 8 * n, count)
            if drawn not in picked:
                picked.append(drawn)
                break
        else:
            return None
    return picked


def flat(x, y, limit=FLAT):
    """Tell whether three of the points are nearly on a line, or two of two are one."""
    points = np.stack((x, y), 1)
    if len(x) == 2:
        return np.sum((points[1] - points[0]) ** 2) <= limit
    triples = [t for t in np.ndindex(*[len(x)] * 3) if t[0] < t[1] < t[2]]
    return any(abs(np.linalg.det((points[j] - points[i], points[k] - points[i]))) <= limit
               for i, j, k in triples)  # fmt: skip


def solve(kind, x, y, u, v):
    """Return the map of a sample, or None for one that is flat or crosses the horizon."""
    if flat(x, y) or flat(u, v):
        return None
    zero, one = np.zeros_like(x), np.ones_like(x)
    if kind == 0:
        rows = np.r_[np.c_[x, -y, one, zero], np.c_[y, x, zero, one]]
        a, b, c, d = np.linalg.solve(rows, np.r_[u, v])
        return np.array([a, -b, c, b, a, d, 0, 0, 1])
    if kind == 1:
        rows = np.c_[x, y, one]
        return np.r_[np.linalg.solve(rows, u), np.linalg.solve(rows, v), 0, 0, 1]
    rows = np.r_[
        np.c_[x, y, one, zero, zero, zero, -u * x, -u * y, -u],
        np.c_[zero, zero, zero, x, y, one, -v * x, -v * y, -v],
    ]
    h = np.linalg.svd(rows)[2][8]
    w = np.c_[x, y, one] @ h[6:]
    return h if (w > 0).all() or (w < 0).all() else None


def seven(x, y, u, v):
    """Return the matrices of seven matches by SVD and NumPy's roots."""
    one = np.ones(7)
    rows = np.stack((u * x, u * y, u, v * x, v * y, v, x, y, one), 1)
    _, s, vt = np.linalg.svd(rows)
    if s[6] < 1e-7:
        return []
    a, b = vt[7:].reshape(2, 3, 3)
    at = [np.linalg.det(a + t * b) for t in (-1.0, 0.0, 1.0, 2.0)]
    cubic = np.polyfit((-1.0, 0.0, 1.0, 2.0), at, 3)
    roots = np.roots(cubic)
    real = roots[np.abs(roots.imag) < 1e-7 * (1 + np.abs(roots))].real
    return [(a + t * b).ravel() for t in real]


# The motion of two views: x1 = R x0 + t, by Cayley's formula.
_CROSS = np.array([[0, -0.02, 0.05], [0.02, 0, -0.03], [-0.05, 0.03, 0]])
ROTATION = np.linalg.solve(np.eye(3) - _CROSS, np.eye(3) + _CROSS)
TRANSLATION = np.array([0.5, 0.1, -0.2])


def true_fundamental():
    """Return [t] R, for points in units of the focal length."""
    x, y, z = TRANSLATION
    f = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ ROTATION
    return f / np.abs(f).max()


def distances(f, matches):
    """Return Sampson distances in float64."""
    a, b = (np.c_[p.T, np.ones(len(p.T))].astype(float) for p in (matches[:2], matches[2:]))
    right, left = a @ f.T, b @ f
    under = (right[:, :2] ** 2).sum(1) + (left[:, :2] ** 2).sum(1)
    return (b * right).sum(1) / np.sqrt(under)


def robust_cost(squares, limit):
    """Sum the integral, up to each squared residual, of the weight (1 - x)^2 / (1 + 10 x)."""
    x = np.minimum(squares / limit, 1.0)
    return np.sum(x**2 / 20 - 0.21 * x + 0.121 * np.log1p(10 * x))


def residuals(h, matches, kind=2):
    """Return squared distances in float32, in the order in which kernels compute them."""
    x, y, u, v = matches
    h = np.asarray(h, np.float32)
    if kind > 2:
        a, b = (h[0] * x + h[1] * y) + h[2], (h[3] * x + h[4] * y) + h[5]
        c = (h[6] * x + h[7] * y) + h[8]
        d, e = (h[0] * u + h[3] * v) + h[6], (h[1] * u + h[4] * v) + h[7]
        n = (a * u + b * v) + c
        return n * n / ((a * a + b * b) + (d * d + e * e))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        w = np.float32(1) / ((h[6] * x + h[7] * y) + h[8])
        dx = ((h[0] * x + h[1] * y) + h[2]) * w - u
        dy = ((h[3] * x + h[4] * y) + h[5]) * w - v
        return dx * dx + dy * dy


def cost(h, matches, square, kind=2):
    """Return the truncated cost in fixed point, and the number of inliers."""
    r = residuals(h, matches, kind)
    inside = r < square
    scale = np.float32(COST_ONE) / np.float32(square)
    units = (r[inside] * scale + np.float32(0.5)).astype(np.int64)
    return int(units.sum() + COST_ONE * np.sum(~inside)), int(inside.sum())


def best_of_group(kind, seed, first, matches, square):
    """Return the hypothesis of least preview and its map, or None."""
    best = None
    for hypothesis in range(first, first + GROUP):
        picked = sample(seed, hypothesis, matches.shape[1], SIZES[kind])
        if picked is None:
            continue
        of = matches[:, picked].astype(float)
        found = seven(*of) if kind == 3 else [h for h in [solve(kind, *of)] if h is not None]
        for h in found:
            preview = cost(h, matches[:, :PREVIEW], square, kind)[0]
            if best is None or preview < best[0]:
                best = preview, hypothesis, h
    return best
