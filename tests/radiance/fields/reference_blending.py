"""Blending of several reference cameras in NumPy, in float64."""

import numpy as np


def blend(origins, eyes, colors, opacity, depths):
    """Return the blended colours (R, 3), opacities and depths; the parts are (K, R, ...)."""
    away = np.linalg.norm(origins[None] - eyes[:, None, :3], axis=2)
    share = np.exp(-eyes[:, 3:] * away) * opacity
    total = share.sum(axis=0)
    share = np.divide(share, total, out=np.zeros_like(share), where=total > 0)
    return (
        (share[..., None] * colors).sum(axis=0), (share * opacity).sum(axis=0),
        (share * depths).sum(axis=0),
    )  # fmt: skip
