"""Votes along the gradient, and discs with soft rims, in float64."""

import numpy as np

from cvkern.kernels.codes.hough import DIRECTION_FACTOR, DIRECTIONS


def directed(mask, orientation, radii, pad):
    """Votes for the two pixels a radius away along each direction, by the documented rounding."""
    height, width = mask.shape
    votes = np.zeros((len(radii), height + 2 * pad, width + 2 * pad), np.int32)
    y, x = np.nonzero(mask)
    turned = orientation[y, x].astype(np.float32) * np.float32(DIRECTION_FACTOR) + np.float32(0.5)
    angle = np.floor(turned) % DIRECTIONS * (2 * np.pi / DIRECTIONS)
    for i, radius in enumerate(radii):
        # In units of 2^-16 directions are whole numbers; the products are exact in float64.
        down, along = (
            np.floor(radius * np.round(65536 * f(angle)) / 65536 + 0.5).astype(int)
            for f in (np.sin, np.cos)
        )
        for side in (1, -1):
            v, u = y + pad + side * down, x + pad + side * along
            inside = (v >= 0) & (u >= 0) & (v < votes.shape[1]) & (u < votes.shape[2])
            np.add.at(votes[i], (v[inside], u[inside]), 1)
    return votes


def arcs(mask, orientation, rings, tolerance):
    """Votes for the offsets of each ring within the tolerance of the gradient, or its opposite."""
    votes = np.zeros((len(rings), *mask.shape), np.int32)
    y, x = np.nonzero(mask)
    for i, ring in enumerate(rings):
        for down, along in ring:
            apart = (np.arctan2(down, along) - orientation[y, x]) % np.pi
            close = np.minimum(apart, np.pi - apart) <= tolerance
            v, u = y[close] + down, x[close] + along
            inside = (v >= 0) & (u >= 0) & (v < mask.shape[0]) & (u < mask.shape[1])
            np.add.at(votes[i], (v[inside], u[inside]), 1)
    return votes


def disc(shape, row, column, radius, blur=0.7):
    """The share of each pixel inside a disc, whose rim is soft: 1 inside, 0 outside."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    return 0.5 - 0.5 * np.tanh((np.hypot(y - row, x - column) - radius) / blur)


def ellipse(shape, row, column, major, minor, turn):
    """1 inside an ellipse, 0 outside, averaged over 4 x 4 places of each pixel."""
    places = (np.arange(4) + 0.5) / 4 - 0.5
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    total = np.zeros(shape)
    for v in places:
        for u in places:
            dy, dx = y + v - row, x + u - column
            along = dx * np.cos(turn) + dy * np.sin(turn)
            across = dy * np.cos(turn) - dx * np.sin(turn)
            total += (along / major) ** 2 + (across / minor) ** 2 < 1
    return total / 16
