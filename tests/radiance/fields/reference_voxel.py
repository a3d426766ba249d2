"""Rays through a grid of density and colour, sample by sample, in float64."""

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.special import sph_harm_y


def harmonics(direction):
    """Real spherical harmonics of degree 0 to 2, in the order l^2 + l + m."""
    x, y, z = direction
    theta, phi = np.arccos(np.clip(z, -1, 1)), np.arctan2(y, x)
    found = []
    for degree in range(3):
        for order in range(-degree, degree + 1):
            value = sph_harm_y(degree, abs(order), theta, phi)
            scale = 1 if order == 0 else np.sqrt(2)
            found.append(scale * (value.imag if order < 0 else value.real))
    return np.array(found)


def jitter(seed, step, ray):
    """The part of a step that a ray begins with: PCG of the seed, the step and the ray."""

    def mix(x):
        state = (x * 747796405 + 2891336453) % 2**32
        word = (((state >> ((state >> 28) + 4)) ^ state) * 277803737) % 2**32
        return (word >> 22) ^ word

    inner = mix(seed ^ (0x1E3779B9 * 4) % 2**32)
    return (mix((ray + mix((step + inner) % 2**32)) % 2**32) >> 8) / 2**24


def places(origin, direction, near, far, finest, cone, unbounded, part):
    """Distances and lengths of all steps of a ray, empty or not, and their points of the grid."""
    first, last = near, far
    if not unbounded:
        with np.errstate(divide="ignore"):
            sides = (np.array([[-1.0], [1.0]]) - origin) / direction
        first, last = max(near, sides.min(0).max()), min(far, sides.max(0).min())
    ts, gaps = [], []
    t = first + part * max(finest, cone * first)
    while t < last:
        ts.append(t)
        gaps.append(max(finest, cone * t))
        t += gaps[-1]
    ts, gaps = np.array(ts), np.array(gaps)
    points = origin + ts[:, None] * direction
    if unbounded:
        size = np.maximum(np.linalg.norm(points, axis=1, keepdims=True), 1)
        points = points * (2 - 1 / size) / size / 2
    return ts, gaps, (points + 1) / 2


def occupied(points, bits, cells):
    """Whether the cells of points in the unit cube are marked."""
    i, j, k = np.clip((points * cells).astype(int), 0, cells - 1).T
    number = (k * cells + j) * cells + i
    return (bits[number >> 5] >> (number & 31)) & 1 == 1


def render(
    origins, directions, active, bits, cells, near, far, finest, cone, unbounded, jittered, seed,
    step, stop, least, basis, density, color,
):  # fmt: skip
    """Return colours, opacities, depths, distortions and numbers of samples."""
    count, resolution = len(origins), len(density) - 1
    out = np.zeros((count, 3)), np.zeros(count), np.zeros(count), np.zeros(count)
    samples = np.zeros(count, int)
    grids = [density, *np.moveaxis(color[..., : 3 * basis], 3, 0)]
    for ray in range(int(active[0])):
        part = jitter(seed, int(step[0]), ray) if jittered else 0.5
        origin, direction = origins[ray].astype(float), directions[ray].astype(float)
        ts, gaps, points = places(origin, direction, near, far, finest, cone, unbounded, part)
        inside = occupied(points, bits, cells) if len(ts) else np.zeros(0, bool)
        ts, gaps, points = ts[inside], gaps[inside], points[inside]
        at = points[:, ::-1].T * resolution
        raw, *rows = (map_coordinates(g, at, order=1, mode="nearest") for g in grids)
        seen = raw > least
        rows = np.reshape([row[seen] for row in rows], (3, basis, -1))
        rgb = 1 / (1 + np.exp(-np.einsum("b,cbs->sc", harmonics(direction)[:basis], rows)))
        t, gap = ts[seen], gaps[seen]
        alpha = 1 - np.exp(-np.exp(np.minimum(raw[seen], 11)) * gap)
        before = np.concatenate(([1.0], np.cumprod(1 - alpha)))[: len(alpha)]
        reached = before > stop
        w = np.where(reached, before * alpha, 0)
        out[0][ray], out[1][ray], out[2][ray] = w @ rgb, w.sum(), w @ t
        apart = np.abs(t[:, None] - t)
        out[3][ray] = w @ apart @ w + (w * w) @ gap / 3
        samples[ray] = reached.sum()
    return *out, samples


def mark(density, cells, least):
    """Bits of the cells with a node above `least`, in order of k, j, i."""
    size = (len(density) - 1) // cells
    found = np.zeros((cells,) * 3, bool)
    for k, j, i in np.ndindex(found.shape):
        part = tuple(slice(n * size, (n + 1) * size + 1) for n in (k, j, i))
        found[k, j, i] = density[part].max() > least
    return np.packbits(found.ravel(), bitorder="little").view(np.uint32)


def total_variation(values, weight):
    """Gradient of weight / 2 times the sum of the squares of all differences of neighbours."""
    gradient = np.zeros(values.shape)
    for axis in range(3):
        step = weight * np.diff(values, axis=axis)
        before, behind = [(0, 0)] * values.ndim, [(0, 0)] * values.ndim
        before[axis], behind[axis] = (1, 0), (0, 1)
        gradient += np.pad(step, before) - np.pad(step, behind)
    return gradient
