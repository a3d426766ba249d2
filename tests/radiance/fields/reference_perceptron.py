"""The original radiance field and its encoding of positions, in float64 NumPy."""

import numpy as np


def positional(points, frequencies, *, include_input=True):
    """Return points (N, D) as in equation 4 of Mildenhall et al. 2020, coordinate by coordinate."""
    points = np.asarray(points, float)
    columns = list(points.T) if include_input else []
    for x in points.T:
        for k in range(frequencies):
            # The sine of a multiple of pi is found from a whole number of turns less.
            angle = np.pi * np.remainder(2.0**k * x, 2.0)
            columns += [np.sin(angle), np.cos(angle)]
    return np.stack(columns, 1)


def padded(values):
    """Return features with a column of ones, and of zeros up to a multiple of 16 columns."""
    count, size = values.shape
    width = -(-(size + 1) // 16) * 16
    return np.hstack([values, np.ones((count, 1)), np.zeros((count, width - size - 1))])


def shapes(width, layers, skip, frequencies, view_frequencies):
    """Return the shapes of the weights, first layer to last."""
    place, view = (
        padded(np.ones((1, 3 + 6 * n))).shape[1] for n in (frequencies, view_frequencies)
    )
    depths = [place] + [width + place * (number == skip) for number in range(1, layers + 1)]
    half = -(-width // 32) * 16
    return [(depth, width) for depth in depths] + [(width + view, half), (half, 16)]


def split(flat, sizes):
    """Return matrices of these shapes from the numbers that they have in turn."""
    ends = np.cumsum([a * b for a, b in sizes])
    return [part.reshape(s) for part, s in zip(np.split(flat, ends[:-1]), sizes, strict=True)]


def field(positions, directions, weights, skip, frequencies, view_frequencies):
    """Return the density (N,) and the colour (N, 3) of samples seen along directions (N, 3)."""
    *layers, features, first, last = weights
    place = padded(positional(positions, frequencies))
    x = place
    for number, w in enumerate(layers, 1):
        x = np.maximum(x @ w, 0)
        if number == skip:
            x = np.hstack([place, x])
    x = x @ features
    sigma = np.exp(np.minimum(x[:, 0], 11))
    seen = np.hstack([x, padded(positional(directions, view_frequencies))])
    raw = np.maximum(seen @ first, 0) @ last
    return sigma, 1 / (1 + np.exp(-raw[:, :3]))
