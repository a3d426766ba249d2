"""Parallel planes in NumPy, in float64, one ray and one plane at a time."""

import numpy as np


def render(origins, directions, disparities, place, texels, stop=0.0):
    """Return the colours, opacities and weighted distances of rays.

    `place` (16,) is the 3 x 4 map to the camera's axes, and fx, fy, cx, cy.
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
            row, column = np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)
            i, j = min(int(row), height - 2), min(int(column), width - 2)
            down, right = row - i, column - j
            four = texels[plane, i : i + 2, j : j + 2]
            found = np.einsum("i,j,ijk->k", [1 - down, down], [1 - right, right], four)
            color[ray] += through * found[:3]
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
