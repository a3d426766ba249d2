"""Gaussian splats in NumPy, in float64: every splat on every pixel, without tiles."""

import numpy as np

NEAR, BLUR, STOP = 0.05, 0.3, 1e-4


def harmonics(d):
    """Return the 16 real spherical harmonics of unit vectors, by their usual formulas."""
    x, y, z = d
    a, b, c = np.sqrt(np.array([3, 15, 5]) / np.pi) / 2
    return np.array([
        0.5 / np.sqrt(np.pi), -a * y, a * z, -a * x,
        b * x * y, -b * y * z, c / 2 * (3 * z * z - 1), -b * x * z, b / 2 * (x * x - y * y),
        -np.sqrt(35 / 2 / np.pi) / 4 * y * (3 * x * x - y * y),
        np.sqrt(105 / np.pi) / 2 * x * y * z,
        -np.sqrt(21 / 2 / np.pi) / 4 * y * (5 * z * z - 1),
        np.sqrt(7 / np.pi) / 4 * z * (5 * z * z - 3),
        -np.sqrt(21 / 2 / np.pi) / 4 * x * (5 * z * z - 1),
        np.sqrt(105 / np.pi) / 4 * z * (x * x - y * y),
        -np.sqrt(35 / 2 / np.pi) / 4 * x * (x * x - 3 * y * y),
    ])  # fmt: skip


def rotation(q):
    """Return the rotation of a quaternion by its product q v q*."""
    w, v = q[0], q[1:]
    cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


def bend(p, lens):
    """Return a direction as the lens shows it, OpenCV's model."""
    (x, y), (k1, k2, p1, p2, k3), r = p, lens[4:], p @ p
    f = 1 + k1 * r + k2 * r**2 + k3 * r**3
    return np.array([
        x * f + 2 * p1 * x * y + p2 * (r + 2 * x * x),
        y * f + p1 * (r + 2 * y * y) + 2 * p2 * x * y,
    ])  # fmt: skip


def bend_slopes(p, lens, step=1e-6):
    """Return the slopes of :func:`bend` by differences."""
    moves = step * np.eye(2)
    return np.stack([(bend(p + m, lens) - bend(p - m, lens)) / (2 * step) for m in moves], 1)


def project(splats, pose, lens, width, height, slopes=None):
    """Return depth, place, inverse covariance, opacity, colour and distance of each splat, or None.

    `slopes` are those of the lens for each splat; by default they follow from its place.
    """
    found = []
    for n, (mean, turn, scale, logit, color, side) in enumerate(zip(*splats, strict=True)):
        arm = mean - pose[:, 3]
        p = pose[:, :3].T @ arm
        opacity = 1 / (1 + np.exp(-logit[0]))
        if p[2] <= NEAR or opacity < 1 / 255 or not turn.any():
            found.append(None)
            continue
        at = p[:2] / p[2]
        d = bend_slopes(at, lens) if slopes is None else slopes[n]
        size, focal = np.array([width, height]), lens[:2]
        half = 0.5 * size / focal
        low, high = -lens[2:4] / focal - 0.3 * half, (size - lens[2:4]) / focal + 0.3 * half
        s = np.clip(at, low, high)
        jacobian = np.diag(focal) @ d @ np.column_stack((np.eye(2), -s)) / p[2]
        turned = rotation(turn / np.linalg.norm(turn))
        around = turned @ np.diag(np.exp(2 * scale)) @ turned.T
        flat = jacobian @ pose[:, :3].T @ around @ pose[:, :3] @ jacobian.T + BLUR * np.eye(2)
        distance = np.linalg.norm(arm)
        coefficients = np.concatenate((color, side[: len(side) // 3 * 3])).reshape(-1, 3)
        shown = 0.5 + harmonics(arm / distance)[: len(coefficients)] @ coefficients
        place = focal * bend(at, lens) + lens[2:4]
        found.append((p[2], place, np.linalg.inv(flat), opacity, np.maximum(shown, 0), distance))
    return found


def render(splats, pose, lens, width, height, stop=STOP, slopes=None):
    """Return the colours, opacities and weighted distances of the pixels, flat."""
    rows, columns = np.mgrid[:height, :width]
    color, depth, through = np.zeros((height, width, 3)), *np.zeros((2, height, width))
    through += 1
    shown = project(splats, pose, lens, width, height, slopes)
    order = sorted(
        (n for n, s in enumerate(shown) if s is not None),
        key=lambda n: (np.float32(shown[n][0]), n),
    )
    for n in order:
        _, place, inverse, opacity, rgb, distance = shown[n]
        apart = np.stack((place[0] - columns, place[1] - rows), -1)
        q = np.einsum("ijk,kl,ijl->ij", apart, inverse, apart)
        alpha = np.minimum(opacity * np.exp(-q / 2), 0.99)
        alpha = np.where((alpha >= 1 / 255) & (through > stop), alpha, 0)
        color += (through * alpha)[..., None] * rgb
        depth += through * alpha * distance
        through = through * (1 - alpha)
    return color.reshape(-1, 3), 1 - through.ravel(), depth.ravel()
