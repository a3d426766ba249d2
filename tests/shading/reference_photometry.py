"""Rules of photometric stereo in NumPy and float64, a pixel at a time."""

import numpy as np

WINDOWS = [(a, b) for a in (0.0, 0.3, 0.6) for b in (0.8, 1.0)]


def ranks(values, limit, scales):
    """Return ranks of scaled values that take part, -1 for the others; earlier ones are lower."""
    part = np.isfinite(values) & (values < limit)
    order = np.full(len(values), -1)
    # What is not finite is left out; what is saturated is not, but it is brighter than the rest.
    numbers = np.flatnonzero(part)
    order[numbers[np.argsort((values * scales)[numbers], kind="stable")]] = np.arange(len(numbers))
    return order


def solve(values, lights, weights):
    a = (lights * weights[:, None]).T @ lights
    a = a + 1e-9 * np.trace(a) * np.eye(3)
    inverse = np.linalg.inv(a)
    return inverse @ (lights.T @ (weights * values)), inverse


def window(values, lights, order, share, method, sweeps):
    """Return the solution of a window of ranks, and the deviation of its normal."""
    n = (order >= 0).sum()
    low, high = (int(np.floor(np.float32(s) * np.float32(n) + np.float32(0.5))) for s in share)
    usable = (order >= 0) & (values > 0)
    if method != "consensus" or usable.sum() < 3:
        usable = order >= 0
    part = usable & (order >= low) & (order < high)
    if part.sum() < 4:
        part = usable
    x, l = values[part], lights[part]
    weights, gamma = np.ones(len(x)), np.ones(len(x))
    if method == "sparse_bayes":
        weights = 1 / (gamma + 1e-6)
    s, inverse = solve(x, l, weights)
    spread = 0.0
    for sweep in range(sweeps + 1):
        if sweep:
            off = np.abs(x - l @ s)
            if method == "sparse_bayes":
                weights = 1 / (gamma + 1e-6)
            elif spread == 0:
                weights = np.ones(len(x))
            elif method == "l1":
                weights = 1 / np.maximum(off / spread, 1e-3)
            else:
                weights = (l @ s > 0) / (1 + (off / spread) ** 2) + 1e-6
            s, inverse = solve(x, l, weights)
        off = x - l @ s
        if method == "sparse_bayes":
            d, lever = weights, np.einsum("ki,ij,kj->k", l, inverse, l)
            e = gamma * d * off / values[usable].max()
            gamma = np.maximum(e * e + gamma - gamma**2 * d * (1 - d * lever), 0)
        used = np.ones(len(x)) if method == "sparse_bayes" else weights
        spread = np.sqrt((used * off**2).sum() / max(used.sum() - 3, 0.5))
    u = s / np.linalg.norm(s)
    turn = (np.trace(inverse) - u @ inverse @ u) / (s @ s)
    return s, spread * np.sqrt(max(turn, 0))


def pixel(values, lights, method, limit=np.inf):
    """Return the normal, the albedo and the residual of a pixel."""
    scales = np.ones(len(values))
    if method in ("trimmed", "consensus"):
        scales = 1 / np.linalg.norm(lights, axis=1)
    order = ranks(values, limit, scales)
    values, lights = values * scales, lights * scales[:, None]
    shares = {"trimmed": [(0.3, 0.9)], "consensus": WINDOWS}.get(method, [(0.0, 1.0)])
    sweeps = {"l1": 20, "sparse_bayes": 50, "consensus": 3}.get(method, 0)
    found = [window(values, lights, order, share, method, sweeps) for share in shares]
    lengths = np.array([np.linalg.norm(s) for s, _ in found])
    trust = np.array([1 / (e + 1e-6) for _, e in found]) if len(found) > 1 else np.ones(1)
    normal = sum(t * s / n for t, n, (s, _) in zip(trust, lengths, found, strict=True))
    normal = normal / np.linalg.norm(normal)
    albedo = (trust * lengths).sum() / trust.sum()
    part = order >= 0
    off = values[part] - np.maximum(albedo * (lights[part] @ normal), 0)
    return normal, albedo, np.sqrt(np.mean((off / scales[part]) ** 2))
