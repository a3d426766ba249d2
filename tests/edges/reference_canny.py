"""Canny's edge detector in float64: the pixels that must be edges, and those that may be."""

from typing import Any, NamedTuple

import numpy as np
import scipy.ndimage as ndi

from tests.reference_rounding import U, gaussian_error, gaussian_kernel

_EIGHT = np.ones((3, 3), int)
_SLOPES: Any = (1, 0), (0, 1)


class Edges(NamedTuple):
    """Bounds of every correct float32 answer: ``certain <= answer <= possible``."""

    certain: np.ndarray
    possible: np.ndarray


def slopes(image, sigma, mode="reflect", cval=0.0):
    """Differentiate by the derivatives of a Gaussian; return dy and dx.

    A constant border goes on in every direction (in SciPy, one axis does not see past the other).
    """
    image = np.asarray(image, float)
    margin = len(gaussian_kernel(sigma)) // 2 if mode == "constant" else 0
    wide = np.pad(image, margin, constant_values=cval)
    inner = tuple(slice(margin, margin + n) for n in image.shape)
    options: dict[str, Any] = {"mode": "nearest" if margin else mode}
    return [ndi.gaussian_filter(wide, sigma, order, **options)[inner] for order in _SLOPES]


def _neighbour(m, dy, dx):
    """Value of the pixel (dy, dx) further on, 0 outside the image."""
    wide = np.pad(m, 1)
    height, width = m.shape
    return wide[1 + dy : 1 + dy + height, 1 + dx : 1 + dx + width]


def _hysteresis(weak, strong):
    labelled: Any = ndi.label(weak, _EIGHT)
    labels = labelled[0]
    return np.isin(labels, np.unique(labels[strong & weak])) & weak


def canny(image, sigma, low, high, norm="l2", mode="reflect", cval=0.0):
    """Detect edges with derivatives of the Gaussian and interpolated neighbours (Canny 1986).

    float32 derivatives are wrong by up to e, and so are decisions on lengths that differ by less.
    Hysteresis only grows with the pixels given to it: deciding every doubt to the one side, then
    to the other, bounds the answer.
    """
    image = np.asarray(image, float)
    dy, dx = slopes(image, sigma, mode, cval)
    m = np.hypot(dy, dx) if norm == "l2" else np.abs(dy) + np.abs(dx)
    e = gaussian_error(image, sigma, (0, 1), cval=cval)

    big = np.maximum(abs(dy), abs(dx))
    back, ahead = beside(m, dy, dx)
    around = ndi.maximum_filter(m, 3, mode="constant")
    # m is wrong by up to 2 e, big and small by e, both sides of the comparison: at most
    # 2 (2 e big + e around) + 2 e around, and six roundings of products below big * around.
    doubt = 4 * e * (big + around) + 8 * U * big * around
    length_doubt = 2 * e + 4 * U * m
    found = []
    for sign in (1, -1):
        top = (m * big - back > sign * doubt) & (m * big - ahead > sign * doubt)
        weak = top & (m > low + sign * length_doubt)
        found.append(_hysteresis(weak, weak & (m > high + sign * length_doubt)))
    return Edges(*found)


def blurred(image, sigma, mask, mode):
    """Smooth in float64, and undo what masked pixels and a constant border take away."""
    if mask is None:
        mask = np.ones(image.shape, bool)
    options: dict[str, Any] = {"mode": mode}
    smooth = ndi.gaussian_filter(np.where(mask, image, 0.0), sigma, **options)
    return smooth / (ndi.gaussian_filter(mask.astype(float), sigma, **options) + 1e-300)


def beside(m, dy, dx):
    """Interpolate lengths before and behind each pixel; all times the larger derivative."""
    big, small = np.maximum(abs(dy), abs(dx)), np.minimum(abs(dy), abs(dx))
    steep = abs(dy) > abs(dx)
    s = np.where((dx < 0) != (dy < 0), -1, 1)
    sides = []
    for way in (-1, 1):
        straight = np.where(steep, _neighbour(m, way, 0), _neighbour(m, 0, way))
        corner = np.where(s > 0, _neighbour(m, way, way), np.where(
            steep, _neighbour(m, way, -way), _neighbour(m, -way, way)))  # fmt: skip
        sides.append(straight * (big - small) + corner * small)
    return sides
