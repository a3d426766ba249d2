"""Rendered chessboards whose corners are known."""

from functools import cache
from typing import NamedTuple

import numpy as np
import scipy.ndimage as ndi

from cvkern.geometry.cameras.lens import turned

FINER = 4  # samples along a side of a pixel


class View(NamedTuple):
    """A board before a camera of focal length `focal`, tilted about a line in its plane."""

    tilt: float = 0.0
    about: float = 0.0
    roll: float = 0.0
    focal: float = 900.0
    size: tuple[int, int] = (240, 320)


def render(shape, view=View(), noise=0.02, square=20.0, blur=1.0, light=(40.0, 220.0), seed=0):  # noqa: B008
    """Return a picture, float64, and where its inner corners are, (rows * columns, 2), row, column.

    Squares are `square` pixels wide where the board is upright. The square outside the first corner
    is dark. Noise is a share of the contrast.
    """
    picture, corners = _rendered(shape, view, square, blur, light, seed)
    rng = np.random.default_rng(seed)
    return picture + rng.normal(0, noise * (light[1] - light[0]), picture.shape), corners.copy()


@cache
def _rendered(shape, view, square, blur, light, seed):
    """Return a picture without noise, and its corners."""
    rows, columns = shape
    rng = np.random.default_rng(seed)
    height, width = view.size
    axis = np.array([np.cos(view.about), np.sin(view.about), 0])
    rotation = turned(view.tilt * axis) @ turned(np.array([0, 0, view.roll]))
    shift = np.array([*rng.uniform(-0.5, 0.5, 2) / square, view.focal / square])
    shift = shift - rotation @ [(columns - 1) / 2, (rows - 1) / 2, 0]
    camera = np.array(
        [[view.focal, 0, (width - 1) / 2], [0, view.focal, (height - 1) / 2], [0, 0, 1]]
    )
    plane = camera @ np.column_stack((rotation[:, :2], shift))
    y, x = (np.mgrid[: height * FINER, : width * FINER] + 0.5) / FINER - 0.5
    u, v, w = np.tensordot(np.linalg.inv(plane), np.stack((x, y, np.ones_like(x))), 1)
    u, v = u / w, v / w
    edge = _inside(u, columns) * _inside(v, rows)
    board = np.where(edge > 0, (_stripes(u) * _stripes(v) + 1) / 2 * edge, 0)
    picture = light[1] + (light[0] - light[1]) * board
    picture = ndi.gaussian_filter(picture, blur * FINER, truncate=3)
    picture = picture.reshape(height, FINER, width, FINER).mean(axis=(1, 3))
    i, j = np.indices(shape).reshape(2, -1)
    x, y, w = plane @ np.stack((j, i, np.ones_like(i)))
    return picture, np.stack((y / w, x / w), axis=1)


def _steep(u):
    """Return how much a coordinate changes from sample to sample."""
    return np.hypot(*np.gradient(u))


def _stripes(u):
    """Return 1 and -1 in turns, from -1 <= u < 0 on, with borders as wide as a sample."""
    away = np.abs((u + 0.5) % 2 - 1) - 0.5  # distance to the next border
    return -np.clip(2 * away / _steep(u), -1, 1)


def _inside(u, last):
    """Return 1 in the board and 0 outside, with borders as wide as a sample."""
    return np.clip(np.minimum(u + 1, last - u) / _steep(u) + 0.5, 0, 1)
