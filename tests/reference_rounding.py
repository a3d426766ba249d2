"""Bounds on the error of float32 sums."""

from typing import Any

import numpy as np
import scipy.ndimage as ndi

U = 2.0**-24  # half a unit in the last place of float32, relative


def separable_error(image, *kernels, cval=0.0):
    """Bound the error of correlating with one kernel after the other.

    A sum of n products of rounded taps is wrong by at most (n + 2) U of the sum of their sizes;
    the image was rounded once; a hundredth covers the terms in U^2.
    """
    peak = max(np.abs(np.asarray(image, float)).max(), abs(cval))
    size = np.prod([max(1.0, np.abs(taps).sum()) for taps in kernels])
    return 1.01 * (sum(len(taps) + 2 for taps in kernels) + 1) * U * size * peak + 1e-37


def gaussian_kernel(sigma, order=0, truncate=4.0):
    """Return SciPy's taps: its answer to an impulse."""
    radius = int(truncate * sigma + 0.5)
    impulse = np.zeros(2 * radius + 1)
    impulse[radius] = 1
    if sigma <= 1e-15:  # where SciPy, too, leaves the axis alone
        return impulse
    return ndi.gaussian_filter1d(impulse, sigma, order=order, truncate=truncate, mode="constant")


def gaussian_error(image, sigma: Any, order: Any = 0, truncate=4.0, cval=0.0):
    """Bound the error of a Gaussian; `sigma` and `order` are one number or two."""
    sigmas, orders = np.broadcast_to(sigma, 2), np.broadcast_to(order, 2)
    kernels = [gaussian_kernel(s, o, truncate) for s, o in zip(sigmas, orders, strict=True)]
    return separable_error(image, *kernels, cval=cval)
