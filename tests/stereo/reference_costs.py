"""Matching costs as they are defined, window by window, in int64 or float64."""

import itertools

import numpy as np


def continued(image, radius_y, radius_x, shift=0):
    """Return (H, W, C) with its nearest pixels round it, seen `shift` pixels to the left."""
    rows = np.arange(-radius_y, image.shape[0] + radius_y).clip(0, image.shape[0] - 1)
    columns = np.arange(-radius_x, image.shape[1] + radius_x) - shift
    return image[rows[:, None], columns.clip(0, image.shape[1] - 1)]


def between(image, radius_y, radius_x, shift):
    """Return the result of `continued`, and the least and largest value half way to neighbours."""
    before, here, behind = (continued(image, radius_y, radius_x, shift + s) for s in (1, 0, -1))
    halves = [before + here, here + behind]
    halves = [h // 2 if h.dtype.kind == "i" else h / 2 for h in halves]
    return here, np.minimum.reduce([here, *halves]), np.maximum.reduce([here, *halves])


def per_pixel(left, right, d, cost, radius_y, radius_x):
    """Return the costs of all pixels that windows reach, summed over the channels."""
    if cost == "birchfield_tomasi":
        a, a_low, a_high = between(left, radius_y, radius_x, 0)
        b, b_low, b_high = between(right, radius_y, radius_x, d)
        one = np.maximum.reduce([a - b_high, b_low - a, 0 * a])
        other = np.maximum.reduce([b - a_high, a_low - b, 0 * a])
        return np.minimum(one, other).sum(-1)
    gap = continued(left, radius_y, radius_x) - continued(right, radius_y, radius_x, d)
    return (np.abs(gap) if cost == "sad" else gap**2).sum(-1)


def windows(values, radius_y, radius_x):
    """View the windows of (H + 2 radius_y, W + 2 radius_x, ...) in two axes behind the others."""
    sides = 2 * radius_y + 1, 2 * radius_x + 1
    return np.lib.stride_tricks.sliding_window_view(values, sides, (0, 1))


def correlation(left, right, d, radius_y, radius_x):
    """Return one less the zero-mean normalised cross-correlation of the windows."""
    images = continued(left, radius_y, radius_x), continued(right, radius_y, radius_x, d)
    one, other = (
        w - w.mean((-2, -1), keepdims=True)
        for w in (windows(image, radius_y, radius_x) for image in images)
    )
    energies = [(w * w).sum((-3, -2, -1)) for w in (one, other)]
    flat = np.minimum(*energies) < 1e-7
    norm = np.sqrt(energies[0] * energies[1])
    return 1 - np.where(flat, 0, (one * other).sum((-3, -2, -1)) / np.where(flat, 1, norm))


def census(image, radius_y, radius_x, spacing, symmetric):
    """Return the comparisons of each pixel, one behind the other: (H, W, C, N) bool."""
    sides = range(-radius_y, radius_y + 1), range(-radius_x, radius_x + 1)
    offsets = list(itertools.product(*sides))
    middle = len(offsets) // 2
    offsets = offsets[:middle] if symmetric else offsets[:middle] + offsets[middle + 1 :]

    def seen(v, u):
        down, along = radius_y * spacing, radius_x * spacing
        wide = continued(image, down, along)
        top, beside = down + v * spacing, along + u * spacing
        return wide[top : top + image.shape[0], beside : beside + image.shape[1]]

    return np.stack(
        [seen(v, u) < (seen(-v, -u) if symmetric else image) for v, u in offsets], axis=-1
    )


def stereo_cost(left, right, disparities, cost, radii, around=(0, 0), spacing=1):
    """Return the costs (H, W, D) of images (H, W, C)."""
    kind = np.int64 if left.dtype.kind == "u" and cost != "zncc" else np.float64
    left, right = left.astype(kind), right.astype(kind)
    if cost.startswith("census"):
        down, along = around
        one, other = (
            census(image, down, along, spacing, cost == "census_symmetric")
            for image in (left, right)
        )
        one, other = (bits.reshape(*left.shape[:2], -1) for bits in (one, other))
        left, right, cost = one.astype(np.int64), other.astype(np.int64), "sad"
    volume = []
    for d in range(*disparities):
        if cost == "zncc":
            volume.append(correlation(left, right, d, *radii))
        else:
            volume.append(windows(per_pixel(left, right, d, cost, *radii), *radii).sum((-2, -1)))
    return np.stack(volume, axis=-1)
