"""Pictures with known edges: each pixel holds the share of its area that a shape covers."""

import numpy as np


def half_plane(shape, angle, distance):
    """Cover what lies beyond ``sin(angle) y + cos(angle) x = distance``.

    The area of a square that a line cuts off, as a difference of four squared ramps.
    """
    y, x = np.mgrid[: shape[0], : shape[1]]
    ny, nx = np.sin(angle), np.cos(angle)
    t = ny * y + nx * x - distance
    a, b = np.maximum(np.abs([ny, nx]), 1e-6)  # along an axis the closed form is 0 / 0
    ramps = sum(
        sign * np.maximum(t + shift, 0) ** 2
        for sign, shift in (
            (1, (a + b) / 2), (-1, (a - b) / 2), (-1, (b - a) / 2), (1, -(a + b) / 2),
        )
    )  # fmt: skip
    return ramps / (2 * a * b)


def disc(shape, centre, radius, samples=64):
    """Cover a disc: exact down the rows, at `samples` places across each pixel."""
    offsets = (np.arange(samples) + 0.5) / samples - 0.5
    x = np.arange(shape[1])[:, None] + offsets - centre[1]
    half = np.sqrt(np.maximum(radius**2 - x**2, 0))
    y = np.arange(shape[0])[:, None, None]
    top, bottom = centre[0] - half, centre[0] + half
    inside = np.minimum(y + 0.5, bottom) - np.maximum(y - 0.5, top)
    return np.maximum(inside, 0).mean(-1)
