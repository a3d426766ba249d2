"""Refinement of disparities in NumPy, pixel by pixel."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components


def left_right(disparity, right, tolerance):
    """Keep d where the right disparity at x - floor(d + 1/2) is within the tolerance."""
    checked = np.full(disparity.shape, np.nan, np.float32)
    for (y, x), d in np.ndenumerate(disparity):
        at = x - np.floor(d + 0.5)
        if 0 <= at < disparity.shape[1] and abs(d - right[y, int(at)]) <= tolerance:
            checked[y, x] = d
    return checked


def remove_speckles(disparity, min_size, difference):
    """Components of the graph of neighbours that differ by at most `difference`, by SciPy."""
    labels = np.arange(disparity.size).reshape(disparity.shape)
    pairs = []
    for a, b in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        joined = np.abs(disparity[a] - disparity[b]) <= np.float32(difference)
        pairs.append((labels[a][joined], labels[b][joined]))
    rows, columns = (np.concatenate(ends) for ends in zip(*pairs, strict=True))
    graph = coo_array((np.ones(len(rows)), (rows, columns)), shape=(disparity.size,) * 2)
    _, region = connected_components(graph, directed=False)
    large = np.bincount(region)[region].reshape(disparity.shape) >= min_size
    return np.where(large, disparity, np.float32(np.nan))


def fill(disparity):
    """Return the map with the smaller neighbour along the row in gaps, and what was no gap."""
    valid = np.isfinite(disparity)
    filled = np.full(disparity.shape, np.nan, np.float32)
    rows = np.flatnonzero(valid.any(1))
    for y, x in np.ndindex(disparity.shape):
        if not len(rows):
            continue
        above = rows[rows <= y]
        source = above[-1] if len(above) else rows[0]
        columns = np.flatnonzero(valid[source])
        bounds = [*columns[columns <= x][-1:], *columns[columns >= x][:1]]
        filled[y, x] = min(disparity[source, bounds])
    return filled, valid


def guided_median(disparity, guide, radius, contrast):
    """Sort each window; take the first value with half of the weight up to it."""
    for axis in (1, 0):
        size = disparity.shape[axis]
        smooth = np.full(disparity.shape, np.nan, np.float32)
        for at in np.ndindex(disparity.shape):
            window = np.clip(np.arange(at[axis] - radius, at[axis] + radius + 1), 0, size - 1)
            line = (at[0], window) if axis == 1 else (window, at[1])
            values = disparity[line]
            unlike = np.abs(guide[line].astype(int) - int(guide[at]))
            weights = np.where(np.isnan(values), 0, np.maximum(1, contrast - unlike))
            if weights.any():
                order = np.argsort(values)
                half = 2 * np.cumsum(weights[order]) >= weights.sum()
                smooth[at] = values[order][np.argmax(half)]
        disparity = smooth
    return disparity


def gray_bytes(image, scale):
    """Return the grey values of 8 bits of (H, W, C)."""
    if image.dtype != np.uint8:
        scaled = (image * np.float32(scale)).astype(np.float32)
        scaled = np.where(np.isnan(scaled), np.float32(0), scaled).clip(0, 255)
        image = np.floor(scaled + np.float32(0.5))
    image = image.astype(int)
    if image.shape[2] == 1:
        return image[..., 0].astype(np.uint8)
    return ((image[..., :3] * np.array([77, 150, 29])).sum(2) + 128 >> 8).astype(np.uint8)
