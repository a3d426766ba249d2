"""Plain NumPy statements of the filter primitives."""

import numpy as np
import scipy.ndimage as ndi

from cvkern.kernels.codes import ATAN, Border

_PAD = {
    Border.REFLECT: "symmetric",
    Border.CONSTANT: "constant",
    Border.NEAREST: "edge",
    Border.MIRROR: "reflect",
    Border.WRAP: "wrap",
}


def _correlate(src, taps, axis, border, cval):
    """Correlate one axis, tap by tap from the first, in the dtype of `src`."""
    n, r = src.shape[axis], len(taps) // 2
    width = [(r, r) if a == axis else (0, 0) for a in range(src.ndim)]
    fill = {"constant_values": cval} if border == Border.CONSTANT else {}
    wide = np.pad(src, width, mode=_PAD[border], **fill)
    acc = np.zeros_like(src)
    for t, tap in enumerate(taps.astype(src.dtype)):
        acc = acc + tap * np.take(wide, range(t, t + n), axis)
    return acc


def correlate_separable(src, taps_y, taps_x, step, border, cval):
    """Correlate the rows, then the columns of (P, H, W * step), in the dtype of `src`."""
    pixels = src.reshape(*src.shape[:2], -1, step)
    down = _correlate(pixels, taps_y, 1, border, src.dtype.type(cval))
    return _correlate(down, taps_x, 2, border, src.dtype.type(cval)).reshape(src.shape)


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


def median(src, radius, step, border, cval):
    """Take the median of square windows of (P, H, W * step)."""
    pixels = src.reshape(*src.shape[:2], -1, step)
    size = (1, 2 * radius + 1, 2 * radius + 1, 1)
    mode = Border(border).name.lower()
    return ndi.median_filter(pixels, size, mode=mode, cval=cval).reshape(src.shape)
