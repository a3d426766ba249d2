"""Votes of the generalised Hough transform in float64: bounds for every correct count."""

from typing import NamedTuple

import numpy as np


class Bounds(NamedTuple):
    """Votes that are beyond doubt, and those that rounding could add."""

    certain: np.ndarray
    possible: np.ndarray


def votes(points, angles, vectors, orientation, rotations, scales, tolerance, shape, cell):
    """Return bounds of the votes (R, S, rows, columns) of edge points (row, column) and angles.

    A vote falls at a whole pixel, the nearest; how far off kernels may round is derived below.
    """
    cells = tuple(-(-n // cell) for n in shape)
    bounds = Bounds(*(np.zeros((len(rotations), len(scales), *cells), int) for _ in range(2)))
    # Directions are kept to 1/16384 turn, three of them here, each half of that off; and the
    # window's ends are rounded.
    angle_error = 2 * (2 * np.pi / 16384)
    for r, rotation in enumerate(rotations):
        turn = np.array(
            [[np.cos(rotation), np.sin(rotation)], [-np.sin(rotation), np.cos(rotation)]]
        )
        for s, scale in enumerate(scales):
            # 1/512 pixel of the vector and 1/32 of the turned one, each scaled, and 1/4096 of the
            # scale; the sines' 2^-21 vanishes in the margin of a fifth.
            error = 1.2 * (scale * (1 / 512 + 1 / 32) + np.hypot(*vectors.T).max() / 4096)
            for vector, angle in zip(vectors, orientation, strict=True):
                off = np.abs((angles - angle - rotation + np.pi) % (2 * np.pi) - np.pi)
                place = points + scale * (turn @ vector)
                for near in (False, True):
                    within = off <= tolerance + (angle_error if near else -angle_error)
                    low = np.floor(place[within] - error + 0.5).astype(int)
                    high = np.floor(place[within] + error + 0.5).astype(int)
                    for corner in range(4) if near else (0,):
                        at = np.where([corner & 1, corner >> 1], high, low)
                        # Each cell once, and for certain only where there is but one.
                        if near:
                            new = np.ones(len(at), bool)
                            for before in range(corner):
                                old = np.where([before & 1, before >> 1], high, low)
                                new &= (old // cell != at // cell).any(axis=1)
                            at = at[new]
                        else:
                            at = at[(low // cell == high // cell).all(axis=1)]
                        inside = ((at >= 0) & (at < shape)).all(axis=1)
                        if not near:  # a pixel that may be outside is not for certain
                            both = (low >= 0) & (high < shape)
                            inside &= both[(low // cell == high // cell).all(axis=1)].all(axis=1)
                        target = bounds.possible if near else bounds.certain
                        np.add.at(target[r, s], tuple((at[inside] // cell).T), 1)
    return bounds
