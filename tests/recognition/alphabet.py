"""Objects made of an alphabet of parts, and scenes with them whose truth is known."""

import numpy as np
import scipy.ndimage as ndi

HEIGHT, WIDTH = 32, 48


def parts(count, side=16, seed=0):
    """Return smooth textures with values in [0, 1]."""
    rng = np.random.default_rng(seed)
    values = ndi.gaussian_filter(rng.normal(size=(count, side, side)), (0, 1.5, 1.5))
    low = values.min(axis=(1, 2), keepdims=True)
    return (values - low) / (values.max(axis=(1, 2), keepdims=True) - low)


LETTERS = parts(24)


def thing(word=(0, 1, 2, 3, 4, 5), noise=0.0, seed=0):
    """Return an object: two rows of three parts."""
    rows = [np.hstack([LETTERS[i] for i in word[r : r + 3]]) for r in (0, 3)]
    values = np.vstack(rows) + np.random.default_rng(seed).normal(0, noise, (HEIGHT, WIDTH))
    return values.clip(0, 1).astype(np.float32)


def things(count):
    return [thing(noise=0.08, seed=seed) for seed in range(count)]


def clutter(shape, seed=0):
    """Return the same parts in no order, on a grid that begins anywhere."""
    rng = np.random.default_rng(seed)
    rows, columns = shape[0] // 16 + 2, shape[1] // 16 + 2
    blocks = LETTERS[rng.integers(0, len(LETTERS), (rows, columns))]
    whole = blocks.transpose(0, 2, 1, 3).reshape(16 * rows, 16 * columns)
    top, left = rng.integers(0, 16, 2)
    return whole[top : top + shape[0], left : left + shape[1]].astype(np.float32)


def put(image, what, row, column):
    """Put an object into a scene, and return its box."""
    height, width = what.shape
    image[row : row + height, column : column + width] = what
    return row, column, row + height, column + width


def overlap(a, b):
    """Return the intersection of two boxes over their union."""
    sides = [max(0.0, min(a[i + 2], b[i + 2]) - max(a[i], b[i])) for i in (0, 1)]
    areas = [(box[2] - box[0]) * (box[3] - box[1]) for box in (a, b)]
    return sides[0] * sides[1] / (sum(areas) - sides[0] * sides[1])
