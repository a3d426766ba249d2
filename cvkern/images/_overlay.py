"""Anti-aliased discs, segments and circles: their coverage of pixels, and blending."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from cvkern._arrays import library
from cvkern._checks import as_numbers, check_number
from cvkern._whites import white_of

SAMPLES = 4  # samples per side of a pixel; each of the 16 has an anti-aliasing ramp
CHUNK = 1 << 16  # pixels sampled at a time, which bounds the memory
PLACES = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5

FARTHEST = 0.84  # reach of a sample and its ramp from the pixel's centre: sqrt(1/2) + 1/8

# A function of (item, row, column): the distance from the centre line of the item, in pixels.
Distance = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def discs(points: np.ndarray) -> tuple[np.ndarray, Distance]:
    """Return the centres, and the function of the distance from them."""

    def distance(item: np.ndarray, y: np.ndarray, x: np.ndarray) -> np.ndarray:
        return np.hypot(y - points[item, 0], x - points[item, 1])

    return np.column_stack((np.arange(len(points)), points)), distance


def segments(ends: np.ndarray, half: float, shape: tuple[int, int]) -> tuple[np.ndarray, Distance]:
    """Return points along segments, at most a pixel apart, and the distance function."""
    start, along = ends[:, :2], ends[:, 2:] - ends[:, :2]
    # Walk only along the part of each segment that lies inside the image.
    enter, leave = np.zeros(len(ends)), np.ones(len(ends))
    margin = min(half, max(shape)) + 2.0  # wider shapes are sampled at every pixel
    for axis in (0, 1):
        bounds = np.array((-margin, shape[axis] - 1 + margin))
        with np.errstate(divide="ignore", invalid="ignore"):
            meets = np.sort((bounds - start[:, axis, None]) / along[:, axis, None], axis=1)
        inside = (start[:, axis] >= bounds[0]) & (start[:, axis] <= bounds[1])
        still = along[:, axis] == 0
        enter = np.where(still, np.where(inside, enter, 2.0), np.fmax(enter, meets[:, 0]))
        leave = np.where(still, leave, np.fmin(leave, meets[:, 1]))
    item = np.flatnonzero(enter <= leave)
    length = np.hypot(along[item, 0], along[item, 1]) * (leave - enter)[item]
    count = np.ceil(length).astype(np.int64) + 1
    item = np.repeat(item, count)
    step = np.arange(len(item)) - np.repeat(np.cumsum(count) - count, count)
    t = enter[item] + (leave - enter)[item] * step / np.maximum(np.repeat(count, count) - 1, 1)
    places = start[item] + t[:, None] * along[item]
    squared = np.maximum((along**2).sum(axis=1), np.finfo(np.float64).tiny)

    def distance(item: np.ndarray, y: np.ndarray, x: np.ndarray) -> np.ndarray:
        dy, dx = y - start[item, 0], x - start[item, 1]
        t = ((dy * along[item, 0] + dx * along[item, 1]) / squared[item]).clip(0.0, 1.0)
        return np.hypot(dy - t * along[item, 0], dx - t * along[item, 1])

    return np.column_stack((item, places)), distance


def across(theta: np.ndarray, rho: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return segments (N, 4) of lines, given by their normals, that cross the whole image."""
    row, column = (n / 2 for n in shape)
    c, s = np.cos(theta), np.sin(theta)
    off = rho - column * c - row * s
    y, x, reach = row + off * s, column + off * c, np.hypot(row, column)
    return np.stack((y + reach * c, x - reach * s, y - reach * c, x + reach * s), axis=1)


def circles(rings: np.ndarray, half: float, shape: tuple[int, int]) -> tuple[np.ndarray, Distance]:
    """Return the points where circles cross rows and columns, and the distance function."""
    margin = min(half, max(shape)) + 2.0  # wider shapes are sampled at every pixel
    found = []
    for i, (y, x, radius) in enumerate(rings):
        places = [(y - radius, x), (y + radius, x), (y, x - radius), (y, x + radius)]
        found.append(np.column_stack((np.full(4, i), places)))
        for axis, centre, other in ((0, y, x), (1, x, y)):
            low = max(np.ceil(centre - radius), -np.ceil(margin))
            high = min(np.floor(centre + radius), shape[axis] - 1 + np.ceil(margin))
            line = np.arange(low, high + 1)
            half = np.sqrt(np.maximum(radius**2 - (line - centre) ** 2, 0.0))
            for side in (other - half, other + half):
                pair = (line, side) if axis == 0 else (side, line)
                found.append(np.column_stack((np.full(len(line), i), *pair)))

    def distance(item: np.ndarray, y: np.ndarray, x: np.ndarray) -> np.ndarray:
        to_centre = np.hypot(y - rings[item, 0], x - rings[item, 1])
        return np.abs(to_centre - rings[item, 2])

    return np.concatenate(found) if found else np.empty((0, 3)), distance


def coverage(
    places: np.ndarray, distance: Distance, half: float, shape: tuple[int, int], count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (item, flat pixel index, covered share) of every pixel that a shape touches.

    Each of the `count` shapes lies within `half` of its centre line. `places` are (item, row,
    column); every point of a centre line in the image has one of them within a pixel. Pixels
    outside `shape` are dropped.
    """
    size = shape[0] * shape[1]
    if 2 * half > max(shape):
        found = [np.zeros(0, np.int64)]
        for begin in range(0, count * size, CHUNK):
            key = np.arange(begin, min(begin + CHUNK, count * size))
            item, pixel = np.divmod(key, size)
            found.append(key[distance(item, *np.divmod(pixel, shape[1])) < half + FARTHEST])
        return _shares(np.concatenate(found), distance, half, shape)
    reach = int(np.ceil(half + FARTHEST + 1.5))  # 1 to the nearest place, 0.5 for its rounding
    around = np.arange(-reach, reach + 1)
    near = (places[:, 1:] > -reach - 1) & (places[:, 1:] < np.array(shape) + reach)
    places = places[near.all(axis=1)]
    found = []
    for chunk in np.array_split(places, 1 + len(places) * len(around) ** 2 // CHUNK):
        y = np.round(chunk[:, 1]).astype(np.int64)[:, None, None] + around[:, None]
        x = np.round(chunk[:, 2]).astype(np.int64)[:, None, None] + around
        item = chunk[:, 0].astype(np.int64)[:, None, None]
        key = (item * shape[0] + y) * shape[1] + x
        key = np.unique(key[(y >= 0) & (y < shape[0]) & (x >= 0) & (x < shape[1])])
        item, pixel = np.divmod(key, shape[0] * shape[1])
        found.append(key[distance(item, *np.divmod(pixel, shape[1])) < half + FARTHEST])
    return _shares(np.unique(np.concatenate(found)), distance, half, shape)


def _shares(
    key: np.ndarray, distance: Distance, half: float, shape: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return item, pixel and covered share for keys, each of which encodes an item and a pixel."""
    item, pixel = np.divmod(key, shape[0] * shape[1])
    share = np.zeros(len(key))
    for begin in range(0, len(key), CHUNK):
        part = slice(begin, begin + CHUNK)
        y, x = np.divmod(pixel[part], shape[1])
        for dy in PLACES:
            for dx in PLACES:
                d = SAMPLES * distance(item[part], y + dy, x + dx)
                share[part] += (SAMPLES * half - d + 0.5).clip(0.0, 1.0)
                # Subtract the part of a sample's ramp that a thinner line does not cover.
                share[part] -= (0.5 - SAMPLES * half - d).clip(0.0, 1.0)
    shown = share > 0
    return item[shown], pixel[shown], share[shown] / SAMPLES**2


def canvas(image: ArrayLike, name: str = "image") -> np.ndarray:
    """Return a new uint8 RGB array that looks like `image`, an argument called `name`."""
    array = check_numbers(image, name)
    if array.ndim not in (2, 3) or (array.ndim == 3 and array.shape[2] not in (3, 4)):
        raise ValueError(
            f"{name} must have shape (H, W), (H, W, 3) or (H, W, 4), got {array.shape}"
        )
    array = array[..., :3] if array.ndim == 3 else np.repeat(array[..., None], 3, axis=2)
    if array.dtype == np.uint8:
        return array.copy()
    if array.dtype == bool:
        return array * np.uint8(255)
    if array.dtype == np.uint16:
        return np.round(array / (white_of(array) / 255)).astype(np.uint8)
    if array.dtype.kind != "f":
        raise ValueError(f"{name} must be uint8, uint16, bool or floats, got {array.dtype}")
    low, high = array.min(), array.max()
    if not (low >= 0 and high <= 1):  # NaN fails too
        raise ValueError(f"{name} must lie in [0, 1] when it holds floats, got {low} to {high}")
    return np.round(255.0 * array).astype(np.uint8)


def blend(
    canvas: np.ndarray,
    places: np.ndarray,
    distance: Distance,
    half: float,
    colors: np.ndarray,
) -> np.ndarray:
    """Blend the colours of shapes into `canvas` by the share of each pixel that they cover.

    Where shapes overlap, the share is the largest of theirs, and the colour is the mean of theirs,
    weighted by share. Neither depends on the order of the shapes.
    """
    height, width = canvas.shape[:2]
    item, pixel, share = coverage(places, distance, half, (height, width), len(colors))
    on, spot = np.unique(pixel, return_inverse=True)
    most, weight, mixed = np.zeros(len(on)), np.zeros(len(on)), np.zeros((len(on), 3))
    np.maximum.at(most, spot, share)
    np.add.at(weight, spot, share)
    np.add.at(mixed, spot, share[:, None] * colors[item])
    flat = canvas.reshape(-1, 3)
    below = flat[on].astype(np.float64)
    flat[on] = np.round(below + most[:, None] * (mixed / weight[:, None] - below)).astype(np.uint8)
    return canvas


def check_numbers(array: ArrayLike, name: str) -> np.ndarray:
    library(array, name)  # refuses masks and placeholders
    try:
        array = np.asarray(array)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be rectangular, got rows that differ") from None
    if array.dtype.kind not in "buif":
        raise ValueError(f"{name} must hold real numbers, got {array.dtype}")
    if array.size == 0:
        raise ValueError(f"{name} must not be empty, got shape {array.shape}")
    return array.astype(array.dtype.newbyteorder("="), copy=False)


def check_rows(rows: ArrayLike, columns: int, name: str) -> np.ndarray:
    array = as_numbers(rows, name)
    if array.size == 0 and array.ndim < 3:
        return np.empty((0, columns))  # nothing to draw; [] is allowed too
    if array.ndim != 2 or array.shape[1] != columns:
        raise ValueError(f"{name} must have shape (N, {columns}), got {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite, got {array[~np.isfinite(array)][0]}")
    return array


def check_positive(value: float, name: str) -> float:
    number = check_number(value, name, finite=False)
    if number <= 0 or not np.isfinite(number):
        raise ValueError(f"{name} must be finite and > 0, got {number:g}")
    return number


def check_colors(colors: ArrayLike, count: int) -> np.ndarray:
    array = as_numbers(colors, "color")
    if array.ndim == 2 and array.shape == (count, 3):
        if not ((array >= 0) & (array <= 255)).all():
            raise ValueError(f"color must lie in [0, 255], got {array.min()} to {array.max()}")
        return array
    return np.broadcast_to(check_color(colors, "color"), (count, 3))


def check_color(color: ArrayLike, name: str) -> np.ndarray:
    array = as_numbers(color, name)
    if array.shape != (3,) or not ((array >= 0) & (array <= 255)).all():
        raise ValueError(f"{name} must be red, green and blue in [0, 255], got {color}")
    return array
