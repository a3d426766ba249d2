"""Photographs of scenes whose cameras are known."""

import numpy as np
import scipy.ndimage as ndi
from skimage import data
from skimage.transform import resize


def turned(yaw, pitch=0.0, roll=0.0):
    """Return the rotation from the world's axes to a camera's, degrees."""
    a, b, c = np.radians((yaw, pitch, roll))
    y = np.array([[np.cos(a), 0, -np.sin(a)], [0, 1, 0], [np.sin(a), 0, np.cos(a)]])
    x = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    z = np.array([[np.cos(c), np.sin(c), 0], [-np.sin(c), np.cos(c), 0], [0, 0, 1]])
    return z @ x @ y


def wall(focal, height):
    """Return a picture round 360 degrees, grey photographs side by side, (height, 2 pi focal)."""
    photos = (
        data.coffee, data.gravel, data.astronaut, data.grass, data.coins,
        data.immunohistochemistry,
    )  # fmt: skip
    edges = np.linspace(0, round(2 * np.pi * focal), len(photos) + 1).astype(int)
    parts = []
    for photo, width in zip(photos, np.diff(edges), strict=True):
        image = photo()
        gray = image @ (0.2125, 0.7154, 0.0721) if image.ndim == 3 else image.astype(float)
        parts.append(resize(gray, (height, width), anti_aliasing=True))
    return np.concatenate(parts, axis=1)


def bent(points, lens):
    """Return where a lens shows points (2, ...) from the middle, in longest sides."""
    return points * (1 + lens * (points**2).sum(axis=0))


def straight(points, lens):
    """Return the points (2, ...) that a lens shows at the given ones, by fixed-point steps."""
    found = points
    for _ in range(60):
        found = points / (1 + lens * (found**2).sum(axis=0))
    return found


def photograph(picture, around, rotation, focal, shape, lens=0.0):
    """Return what a camera sees of a cylinder with a picture of focal length `around`."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    long = max(shape)
    places = np.stack((x - (shape[1] - 1) / 2, y - (shape[0] - 1) / 2)) / long
    rays = np.stack((*(straight(places, lens) * long / focal), 1 + 0 * x))
    world = np.einsum("ji,jhw->ihw", rotation, rays)
    columns = np.arctan2(world[0], world[2]) * around
    rows = world[1] / np.hypot(world[0], world[2]) * around + (len(picture) - 1) / 2
    places = np.stack((rows, columns % picture.shape[1]))
    wide = np.concatenate((picture, picture[:, :2]), axis=1)
    seen = ndi.map_coordinates(wide, places, order=1, mode="nearest")
    return np.floor(seen.clip(0, 255) + 0.5).astype(np.uint8)


def angle_between(a, b):
    """Return the angle of the rotation from a to b, degrees."""
    return np.degrees(np.arccos(np.clip((np.trace(a @ b.T) - 1) / 2, -1, 1)))


def through(photo, matrix, shape):
    """Return a picture of a sheet; the matrix takes (x, y, 1) of the photo to its pixels."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    u = np.linalg.inv(matrix) @ np.stack((x, y, np.ones_like(x))).reshape(3, -1)
    places = (u[1::-1] / u[2]).reshape(2, *shape)
    planes = [
        ndi.map_coordinates(c.astype(float), places, order=1) for c in np.moveaxis(photo, 2, 0)
    ]
    return np.floor(np.stack(planes, axis=2) + 0.5).astype(np.uint8)
