"""Signed distances of solids, float64, from their definitions."""

import numpy as np

from cvkern.kernels.codes.radiance import Shape


def distances(solids, points):
    """Return the distance of each point, (N, 3), to each solid, (S, N)."""
    return np.stack([_distance(solid, np.asarray(points, float)) for solid in solids])


def _distance(solid, points):
    turn, tilt = np.deg2rad(solid.turn), np.deg2rad(solid.tilt)
    p = points - solid.middle
    p = np.stack((np.cos(turn) * p[:, 0] + np.sin(turn) * p[:, 1],
                  np.cos(turn) * p[:, 1] - np.sin(turn) * p[:, 0], p[:, 2]), axis=1)  # fmt: skip
    p = np.stack((p[:, 0], np.cos(tilt) * p[:, 1] + np.sin(tilt) * p[:, 2],
                  np.cos(tilt) * p[:, 2] - np.sin(tilt) * p[:, 1]), axis=1)  # fmt: skip
    size = np.array(solid.size, float)
    flat = np.hypot(p[:, 0], p[:, 1])
    if solid.kind == Shape.ELLIPSOID:
        scaled = np.linalg.norm(p / size, axis=1)
        slope = np.linalg.norm(p / size**2, axis=1)
        return scaled * (scaled - 1) / np.maximum(slope, 1e-6)
    if solid.kind == Shape.TORUS:
        return np.hypot(flat - size[0], p[:, 2]) - size[1]
    if solid.kind == Shape.BOX:
        over = np.abs(p) - size + solid.rounding
    else:
        over = np.stack((flat - size[0], np.abs(p[:, 2]) - size[1]), axis=1) + solid.rounding
    outside = np.linalg.norm(np.maximum(over, 0), axis=1)
    return outside + np.minimum(over.max(axis=1), 0) - solid.rounding
