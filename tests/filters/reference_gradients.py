"""Plain NumPy statements of the gradient primitives."""

import numpy as np

from cvkern.kernels.codes.filters import ATAN


def orientation(dy, dx):
    """The polynomial for atan2(dy, dx), in the dtype of `dy`."""
    real = dy.dtype.type
    ax, ay = np.abs(dx), np.abs(dy)
    hi, lo = np.maximum(ax, ay), np.minimum(ax, ay)
    a = np.divide(lo, hi, out=np.zeros_like(hi), where=hi > 0)
    s = a * a
    p = np.full_like(a, ATAN[-1])
    for c in ATAN[-2::-1]:
        p = p * s + real(c)
    r = p * a
    r = np.where(ay > ax, real(np.pi / 2) - r, r)
    r = np.where(dx < 0, real(np.pi) - r, r)
    return np.where(dy < 0, -r, r)
