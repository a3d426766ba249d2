"""Plain NumPy statements of the rank primitives."""

import scipy.ndimage as ndi

from cvkern.kernels.codes.filters import Border


def median(src, radius, step, border, cval):
    """Take the median of square windows of (P, H, W * step)."""
    pixels = src.reshape(*src.shape[:2], -1, step)
    size = (1, 2 * radius + 1, 2 * radius + 1, 1)
    mode = Border(border).name.lower()
    return ndi.median_filter(pixels, size, mode=mode, cval=cval).reshape(src.shape)
