"""Plain NumPy statements of the primitives of radiance fields, in float64 unless it must not be."""

import numpy as np

from cvkern.kernels.codes.radiance import Background

F32, U32 = np.float32, np.uint32


# ------------------------------------------------------------------------------ random numbers


def _mix(x):
    """PCG-RXS-M-XS-32 [O'Neill 2014] of one step of its generator, in integers of Python's size."""
    state = (x.astype(np.uint64) * 747796405 + 2891336453) & 0xFFFFFFFF
    word = ((((state >> ((state >> 28) + 4)) ^ state) & 0xFFFFFFFF) * 277803737) & 0xFFFFFFFF
    return (word >> 22) ^ word


def random_bits(seed, step, item, which):
    """Return 32 bits for numbers `which` of items."""
    item = np.asarray(item, np.int64)
    mask = np.uint64(0xFFFFFFFF)
    x = _mix(np.uint64((seed & 0xFFFFFFFF) ^ (0x1E3779B9 * which & 0xFFFFFFFF)))
    return _mix((item.astype(np.uint64) + _mix((np.uint64(step) + x) & mask)) & mask)


def random_unit(seed, step, item, which):
    """Return numbers in [0, 1)."""
    return (random_bits(seed, step, item, which) >> np.uint64(8)).astype(float) / 2**24


def random_index(seed, step, item, which, count):
    """Return integers in [0, count)."""
    return (random_bits(seed, step, item, which) * np.uint64(count) >> np.uint64(32)).astype(int)


# --------------------------------------------------------------------------------------- space


def in_cube(points, unbounded):
    """Return (N, 3) points as coordinates from 0 to 1 [mip-NeRF 360, equation 10]."""
    if not unbounded:
        return (points + 1) / 2
    size = np.linalg.norm(points, axis=1, keepdims=True)
    outside = (2 - 1 / np.maximum(size, 1)) * points / np.maximum(size, 1)
    return np.where(size > 1, outside, points) / 4 + 0.5


def cells_of(points, levels, cells):
    """Return the levels of (N, 3) float32 points, and the numbers of their cells there."""
    sides = F32(2) ** np.arange(levels)[:, None]  # cubes have their lower sides
    level = ((points.max(1) >= sides) | (points.min(1) < -sides)).sum(0)
    scale = (F32(cells / 2) / F32(2) ** level.astype(F32))[:, None]
    i, j, k = np.floor(points * scale).astype(int).T + cells // 2
    blocks = cells // 4
    block = ((level * blocks + k // 4) * blocks + j // 4) * blocks + i // 4
    return level, 64 * block + 16 * (k % 4) + 4 * (j % 4) + i % 4


def random_points(numbers, cells, seed, step):
    """Return a random point in each cell."""
    level, *at = np.unravel_index(numbers, (64, *3 * [cells // 4], 4, 4, 4))
    k, j, i = 4 * np.array(at[:3]) + at[3:]
    offset = np.stack([random_unit(seed, step, numbers, which) for which in (1, 2, 3)], 1)
    side = 2.0 ** level[:, None]
    return (np.stack([i, j, k], 1) + offset) * 2 * side / cells - side


def march(origins, directions, occupied, levels, cells, near, far, finest, cone, jitter):
    """Return the distances of all samples of rays in occupied cells, by asking at every step.

    In float32 where a kernel could not otherwise come to the same places.
    """
    side = F32(2.0 ** (levels - 1))
    least = np.where(directions < 0, F32(-1e-12), F32(1e-12))
    inverse = F32(1) / np.where(np.abs(directions) < F32(1e-12), least, directions)
    ends = np.stack([-side - origins, side - origins]) * inverse
    enter, leave = ends.min(0).max(1), ends.max(0).min(1)
    finest, cone = F32(finest), F32(cone)
    t, last = np.maximum(F32(near), enter), np.minimum(F32(far), leave)
    last[enter >= leave] = 0
    t = t + np.asarray(jitter, F32) * np.maximum(finest, cone * t)
    steps = [t]
    while (steps[-1] < last).any():
        steps.append(steps[-1] + np.maximum(finest, cone * steps[-1]))
    found = []
    for t, end, origin, direction in zip(
        np.stack(steps, 1), last, origins, directions, strict=True
    ):
        t = t[: np.searchsorted(t, end)]
        level, cell = cells_of(origin + t[:, None] * direction, levels, cells)
        inside = level < levels
        found.append(t[inside & occupied[np.where(inside, cell, 0)]])
    return found


# --------------------------------------------------------------------------------- compositing


def composite(sigma, rgb, distances, spans, stop):
    """Return colour, opacity, depth and distortion of rays, from their definitions."""
    found = np.zeros((len(spans), 6))
    for ray, (begin, count) in enumerate(spans):
        own = slice(begin, begin + count)
        s, c = sigma[own].astype(float), rgb[own].astype(float)
        t, d = distances[own].astype(float).T
        left = np.exp(-np.concatenate([[0.0], np.cumsum(s * d)]))
        w = np.where(left[:-1] > stop, left[:-1] - left[1:], 0.0)
        distortion = w @ np.abs(t[:, None] - t) @ w + (w * w * d).sum() / 3
        found[ray] = *(w @ c), w.sum(), w @ t, distortion
    return found[:, :3], found[:, 3], found[:, 4], found[:, 5]


def background(kind, learnt, seed, step, rays):
    """Return the colours behind rays."""
    if kind == Background.RANDOM:
        return np.stack([random_unit(seed, step, np.arange(rays), w) for w in (5, 6, 7)], 1)
    colors = {Background.WHITE: np.ones(3), Background.BLACK: np.zeros(3)}
    return np.tile(np.asarray(colors.get(kind, learnt), float), (rays, 1))


def losses(color, opacity, targets, behind, huber):
    """Return the loss and the mean squared error of each ray before a background."""
    seen = targets[:, 3:].astype(float)
    truth = seen * targets[:, :3] + (1 - seen) * behind
    e = color + (1 - opacity[:, None]) * behind - truth
    size = np.abs(e)
    loss = e * e
    if huber > 0:
        loss = np.where(size < huber, e * e / 2, huber * (size - huber / 2))
    return loss.mean(1), (e * e).mean(1)


# ---------------------------------------------------------------------------------- encodings


def hash_corners(positions, resolution, size, fused=False):
    """Return the entries of the corners of each sample's cell, (N, 8), and their weights.

    The place in the cell is what is left of a product rounded to float32, or not if `fused`.
    """
    at = positions.astype(F32) * F32(resolution)  # in float32: which cell it is depends on it
    cell = np.clip(np.floor(at), 0, resolution - 1).astype(np.int64)
    f = (positions.astype(float) * resolution if fused else at.astype(float)) - cell
    entries, weights = [], []
    for corner in np.ndindex(2, 2, 2):
        i, j, k = (cell + corner).T
        if (resolution + 1) ** 3 <= size:
            entries.append((k * (resolution + 1) + j) * (resolution + 1) + i)
        else:
            mask = 2**32 - 1
            entries.append((i ^ (j * 2654435761 & mask) ^ (k * 805459861 & mask)) % size)
        weights.append(np.where(corner, f, 1 - f).prod(1))
    return np.stack(entries, 1), np.stack(weights, 1)


def hash_encode(positions, grids, table, fused=False):
    """Return the features (N, 2 L) of samples, in grids of these resolutions and offsets."""
    resolutions, offsets = grids
    found = []
    for resolution, begin, end in zip(resolutions, offsets[:-1], offsets[1:], strict=True):
        entries, weights = hash_corners(positions, resolution, end - begin, fused)
        found.append((weights[:, :, None] * table[begin + entries].astype(float)).sum(1))
    return np.hstack(found)


def hash_backward(positions, grids, d_features):
    """Return the gradients of the table."""
    resolutions, offsets = grids
    d_table = np.zeros((offsets[-1], 2))
    for level, resolution in enumerate(resolutions):
        begin, end = offsets[level : level + 2]
        entries, weights = hash_corners(positions, resolution, end - begin)
        d = d_features[:, None, 2 * level : 2 * level + 2].astype(float)
        np.add.at(d_table, begin + entries, weights[:, :, None] * d)
    return d_table


# ----------------------------------------------------------------------------------- learning


def adam(weights, gradients, rate, beta1, beta2, epsilon):
    """Return the weights after a step for each gradient [Kingma and Ba 2015, algorithm 1]."""
    m = v = np.zeros_like(weights)
    for t, g in enumerate(gradients, 1):
        m = beta1 * m + (1 - beta1) * g
        v = beta2 * v + (1 - beta2) * g**2
        weights = weights - rate * (m / (1 - beta1**t)) / (np.sqrt(v / (1 - beta2**t)) + epsilon)
    return weights


def slope(function, at, step=1e-5):
    """Return the gradient of a number with respect to an array, by central differences."""
    at = np.asarray(at, float)
    found = np.zeros_like(at)
    for i in np.ndindex(at.shape):
        there = at.copy()
        there[i] += step
        above = function(there)
        there[i] -= 2 * step
        found[i] = (above - function(there)) / (2 * step)
    return found


# ------------------------------------------------------------------------------------ networks


def network_parts(weights, inputs):
    """Cut the weights of the two perceptrons of a hash field into layers."""
    rest = len(weights) - 64 * (inputs + 16 + 64 + 16)
    shapes = [(inputs, 64), (64, 16), (rest // 64, 64), (64, 64), (64, 16)]
    ends = np.cumsum([k * n for k, n in shapes])
    return [w.reshape(s) for w, s in zip(np.split(weights, ends[:-1]), shapes, strict=True)]


def network(features, views, weights, kept=lambda x: x):
    """Return density, colour and what layers give, from features and harmonics of the view.

    What a layer gives to the next goes through `kept`: it may be rounded.
    """
    a, b, c, d, e = network_parts(weights, features.shape[1])
    first = kept(np.maximum(features @ a, 0))
    numbers = first @ b
    hidden = kept(np.concatenate([numbers, views], 1))
    second = kept(np.maximum(hidden @ c, 0))
    third = kept(np.maximum(second @ d, 0))
    sigma = np.exp(np.minimum(numbers[:, 0], 11))
    return sigma, 1 / (1 + np.exp(-(third @ e)[:, :3])), (first, hidden, second, third)


def network_backward(d_sigma, d_rgb, features, views, weights, kept=lambda x: x):
    """Return the gradients of features, weights and lights, by the chain rule from the end."""
    sigma, rgb, (first, hidden, second, third) = network(features, views, weights, kept)
    a, b, c, d, e = network_parts(weights, features.shape[1])
    d_raw = kept(np.pad(d_rgb * rgb * (1 - rgb), ((0, 0), (0, 13))))
    d_third = kept(d_raw @ e.T * (third > 0))
    d_second = kept(d_third @ d.T * (second > 0))
    d_hidden = d_second @ c.T
    d_numbers = d_hidden[:, :16]
    d_numbers[:, 0] += np.clip(d_sigma * sigma, -30000, 30000)
    d_numbers = kept(d_numbers)
    d_first = kept(d_numbers @ b.T * (first > 0))
    pairs = ((features, d_first), (first, d_numbers), (hidden, d_second), (second, d_third),
             (third, d_raw))  # fmt: skip
    d_weights = np.concatenate([(x.T @ dy).ravel() for x, dy in pairs])
    return d_first @ a.T, d_weights, d_hidden[:, 32:]
