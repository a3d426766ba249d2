"""Parallel planes in NumPy, in float64, one ray and one plane at a time."""

import numpy as np


def sides(x, y, count):
    """Return the functions of an offset."""
    x, y = np.clip((x, y), -1.5, 1.5)
    return np.array([x, y, x * x, x * y, y * y])[:count]


def render(origins, directions, disparities, place, texels, stop=0.0, shine=None):
    """Return the colours, opacities and weighted distances of rays.

    `place` (16,) is the 3 x 4 map to the camera's axes, and fx, fy, cx, cy. `shine` has the
    coefficients, the number of planes that share them, and the unit of offsets.
    """
    _, height, width, _ = texels.shape
    inside, lens = place[:12].reshape(3, 4), place[12:]
    color, opacity, depth = np.zeros((len(origins), 3)), *np.zeros((2, len(origins)))
    for ray, (o, d) in enumerate(zip(origins, directions, strict=True)):
        o, d, through = inside[:, :3] @ o + inside[:, 3], inside[:, :3] @ d, 1.0
        for plane, q in enumerate(disparities):
            away = (1 / q - o[2]) / d[2] if d[2] > 1e-6 else -1.0
            if away <= 0 or through <= stop:
                continue
            x, y, z = o + away * d
            column, row = lens[0] * x / z + lens[2], lens[1] * y / z + lens[3]
            if not (-0.5 <= row <= height - 0.5 and -0.5 <= column <= width - 0.5):
                continue
            clipped_row, clipped_column = np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)
            i, j = min(int(clipped_row), height - 2), min(int(clipped_column), width - 2)
            down, right = clipped_row - i, clipped_column - j
            four = texels[plane, i : i + 2, j : j + 2]
            found = np.einsum("i,j,ijk->k", [1 - down, down], [1 - right, right], four)
            own = found[:3]
            if shine is not None:
                maps, shared, reach = shine
                across = (column - (lens[0] * d[0] / d[2] + lens[2])) / reach
                along = (row - (lens[1] * d[1] / d[2] + lens[3])) / reach
                (m, u), (n, v) = (divmod(p / 2, 1) for p in (clipped_row, clipped_column))
                m, n = (min(int(a), s - 2) for a, s in zip((m, n), maps.shape[1:3], strict=True))
                four = maps[plane // shared, m : m + 2, n : n + 2]
                own = own + found[3] * np.einsum(
                    "i,j,ijkc,k->c", [1 - u, u], [1 - v, v],
                    four.reshape(2, 2, -1, 3), sides(across, along, maps.shape[3] // 3),
                )  # fmt: skip
            color[ray] += through * own
            opacity[ray] += through * found[3]
            depth[ray] += through * found[3] * away
            through *= 1 - found[3]
    return color, opacity, depth


def logistic(x):
    return 1 / (1 + np.exp(-x))


def value(parameters):
    """Return the premultiplied colours and the opacities of parameters."""
    opacity = logistic(parameters[..., 3:])
    return np.concatenate((opacity * logistic(parameters[..., :3]), opacity), axis=-1)
