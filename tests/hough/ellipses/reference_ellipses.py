"""The transform of Xie and Ji 2002 in float64, with its angle at the centre."""

import numpy as np


def votes_of(pixels, first, second, accuracy, widest):
    """Return the histogram of the minor semi-axis, and the distance to the nearest bin edge."""
    one, two = pixels[first].astype(float), pixels[second].astype(float)
    center, a = (one + two) / 2, np.linalg.norm(one - two) / 2
    others = np.delete(pixels, (first, second), axis=0).astype(float)
    d, f = np.linalg.norm(others - center, axis=1), np.linalg.norm(others - two, axis=1)
    near = (d > 0) & (d <= a)
    d, f = d[near], f[near]
    cosine = (a**2 + d**2 - f**2) / (2 * a * d)
    sine = 1 - cosine**2
    below = a**2 - d**2 * cosine**2
    off = sine > 1e-12
    b = np.sqrt(a**2 * d[off] ** 2 * sine[off] / below[off])
    b = b[(b >= 0.5) & (b <= widest)]
    places = b / accuracy + 0.5
    bins = np.floor(places).astype(int)
    gap = np.abs(places - np.round(places)).min(initial=np.inf)
    return np.bincount(bins, minlength=2), gap
