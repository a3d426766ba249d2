"""Plain NumPy statements of the filter primitives."""

from typing import Any

import numpy as np

from cvkern.kernels.codes.filters import Border

# numpy.pad's names for the rules of scipy.ndimage
_PAD: dict[int, Any] = {
    Border.REFLECT: {"mode": "symmetric"},
    Border.CONSTANT: {"mode": "constant"},
    Border.NEAREST: {"mode": "edge"},
    Border.MIRROR: {"mode": "reflect"},
    Border.WRAP: {"mode": "wrap"},
}


def correlate(src, taps, axis, border, cval):
    """Correlate one axis, tap by tap from the first, in the dtype of `src`."""
    n, r = src.shape[axis], len(taps) // 2
    width = [(r, r) if a == axis else (0, 0) for a in range(src.ndim)]
    fill = {"constant_values": cval} if border == Border.CONSTANT else {}
    wide = np.pad(src, width, **_PAD[border], **fill)
    acc = np.zeros_like(src)
    for t, tap in enumerate(taps.astype(src.dtype)):
        acc = acc + tap * np.take(wide, range(t, t + n), axis)
    return acc


def correlate_separable(src, taps_y, taps_x, step, border, cval):
    """Correlate the rows, then the columns of (P, H, W * step), in the dtype of `src`."""
    pixels = src.reshape(*src.shape[:2], -1, step)
    down = correlate(pixels, taps_y, 1, border, src.dtype.type(cval))
    return correlate(down, taps_x, 2, border, src.dtype.type(cval)).reshape(src.shape)
