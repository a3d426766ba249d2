"""Residuals of a bundle, and the dense equations of a step, in NumPy."""

import numpy as np
from scipy.spatial.transform import Rotation


def gaps(views, lenses, points, where, ends):
    """Return the residuals, one sighting after the other."""
    found = []
    for (view, lens, point), seen in zip(ends, where, strict=True):
        x, y, z = views[view, :9].reshape(3, 3) @ points[point] + views[view, 9:]
        fx, fy, cx, cy, k1, k2, p1, p2, k3 = lenses[lens]
        if z <= 2.0**-20:
            found.append((1e3, 1e3))
            continue
        u, v = x / z, y / z
        r2 = u * u + v * v
        grown = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
        bx = u * grown + 2 * p1 * u * v + p2 * (r2 + 2 * u * u)
        by = v * grown + p1 * (r2 + 2 * v * v) + 2 * p2 * u * v
        found.append((fx * bx + cx - seen[0], fy * by + cy - seen[1]))
    return np.array(found)


def slopes(views, lenses, points, where, ends, size, step=1e-6):
    """Return derivatives by central differences, (O, 2, 3 + size): the point, then the view."""
    found = np.zeros((len(ends), 2, 3 + size))
    for k in range(3 + size):
        sides = []
        for way in (step, -step):
            v, n, p = views.copy(), lenses.copy(), points.copy()
            if k < 3:
                p[:, k] += way
            elif k < 6:
                turn = Rotation.from_rotvec(way * np.eye(3)[k - 3]).as_matrix()
                v[:, :9] = (turn @ v[:, :9].reshape(-1, 3, 3)).reshape(-1, 9)
            elif k < 9:
                v[:, 9 + k - 6] += way
            elif k == 9:
                n[:, :2] *= np.exp(way)
            else:
                n[:, (4, 5, 2, 3)[k - 10]] += way
            sides.append(gaps(v, n, p, where, ends))
        found[:, :, k] = (sides[0] - sides[1]) / (2 * step)
    return found


def dense(slopes, off, weights, ends, views, points, damping):
    """Return the equations of all views, then of all points, and their gradient."""
    size = slopes.shape[2] - 3
    total = views * size + 3 * points
    rows = np.zeros((len(ends), 2, total))
    for o, (view, _, point) in enumerate(ends):
        rows[o, :, view * size : (view + 1) * size] = slopes[o, :, 3:]
        rows[o, :, views * size + 3 * point : views * size + 3 * point + 3] = slopes[o, :, :3]
    flat = (rows * np.sqrt(weights)[:, None, None]).reshape(-1, total)
    pull = (off * np.sqrt(weights)[:, None]).ravel()
    square = flat.T @ flat
    own = np.arange(views * size, total)
    square[own, own] *= 1 + damping
    return square, flat.T @ pull
