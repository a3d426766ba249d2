"""Motions of a camera before a plane: a homography leaves two of them open."""

from __future__ import annotations

import numpy as np

LEAST = 1e-3  # relative difference of singular values below which a camera only turned


def motions_of(homography: np.ndarray, rays: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the motions (R, t), X1 = R X0 + t with t of length 1, that a homography allows.

    `homography` maps x / z and y / z of the first camera to those of the second; `rays` (N, 2) are
    x / z and y / z of places of the plane in the first one, and must all be before it. None are
    returned for a camera that only turned; else one or two [Ma et al. 2004, section 5.3].
    """
    h = homography / np.linalg.svd(homography, compute_uv=False)[1]
    flat = np.concatenate((rays, np.ones((len(rays), 1))), axis=1)
    if np.median((flat @ h.T)[:, 2]) < 0:
        h = -h
    _, values, v = np.linalg.svd(h)
    long, short = values[0] ** 2, values[2] ** 2
    if values[0] - values[2] < LEAST:
        return []
    if np.linalg.det(v) < 0:
        v = -v
    one, two = np.sqrt(max(0.0, 1 - short)), np.sqrt(max(0.0, long - 1))
    found = []
    for sign in (1.0, -1.0):
        u = (one * v[0] + sign * two * v[2]) / np.sqrt(long - short)
        normal = np.cross(v[1], u)
        before = np.column_stack((v[1], u, normal))
        after = np.column_stack((h @ v[1], h @ u, np.cross(h @ v[1], h @ u)))
        turn = after @ before.T
        shift = (h - turn) @ normal
        ahead = np.sign(flat @ normal)
        if abs(ahead.mean()) > 0.9:  # the plane is on one side of the camera
            shift = shift * np.sign(ahead.mean())
            found.append((turn, shift / np.linalg.norm(shift)))
    return found
