"""Refinement of disparities in NumPy, from the definitions."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components


def left_right(disparity, right, tolerance):
    """Keep d where the right disparity at x - floor(d + 1/2) is within the tolerance."""
    width = disparity.shape[1]
    at = np.arange(width) - np.floor(disparity + 0.5)
    there = (at >= 0) & (at < width)
    partner = np.take_along_axis(right, np.where(there, at, 0).astype(int), 1)
    agrees = there & (np.abs(disparity - partner) <= tolerance)
    return np.where(agrees, disparity, np.nan).astype(np.float32)


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
    rows, x = np.flatnonzero(valid.any(1)), np.arange(disparity.shape[1])
    for y in range(len(disparity) if len(rows) else 0):
        above = rows[rows <= y]
        source = above[-1] if len(above) else rows[0]
        columns = np.flatnonzero(valid[source])
        values = np.concatenate(([np.inf], disparity[source, columns], [np.inf]))
        before = values[np.searchsorted(columns, x, "right")]
        behind = values[np.searchsorted(columns, x, "left") + 1]
        filled[y] = np.minimum(before, behind)
    return filled, valid


def guided_median(disparity, guide, radius, contrast):
    """Sort each window; take the first value with half of the weight up to it."""
    guide = guide.astype(int)
    for _ in range(2):  # along the rows, then along the columns
        size = disparity.shape[1]
        window = np.arange(size)[:, None] + np.arange(-radius, radius + 1)
        window = window.clip(0, size - 1)
        values = disparity[:, window]  # (H, W, window)
        unlike = np.abs(guide[:, window] - guide[..., None])
        weights = np.where(np.isnan(values), 0, np.maximum(1, contrast - unlike))
        order = np.argsort(values, axis=2)
        half = 2 * np.take_along_axis(weights, order, 2).cumsum(2) >= weights.sum(2, keepdims=True)
        first = np.take_along_axis(order, half.argmax(2)[..., None], 2)
        # Where all weights are zero, the first value is as good as any: all are NaN.
        disparity = np.take_along_axis(values, first, 2)[..., 0].T
        guide = guide.T
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
