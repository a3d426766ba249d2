"""Colour maps, made in the OKLab space from a few control points.

References
----------
.. [1] B. Ottosson, "A perceptual color space for image processing", 2020.
"""

from __future__ import annotations

from functools import cache

import numpy as np

# Each control point has a position in [0, 1], lightness, chroma, and hue in degrees. Lightness is
# linear between the points, so equal steps of value look like equal steps of lightness. Chroma is
# an upper bound, reduced where the display cannot show it.
CONTROL_POINTS = {
    "sequential": (  # ink, violet, rose, amber, cream
        (0.0, 0.16, 0.06, 275.0),
        (0.30, 0.40, 0.17, 300.0),
        (0.58, 0.62, 0.20, 372.0),
        (0.82, 0.81, 0.15, 430.0),
        (1.0, 0.97, 0.06, 455.0),
    ),
    "diverging": (  # blue, near white, red
        (0.0, 0.36, 0.15, 258.0),
        (0.26, 0.62, 0.12, 250.0),
        (0.4999, 0.965, 0.004, 245.0),
        (0.5001, 0.965, 0.004, 45.0),
        (0.74, 0.62, 0.15, 38.0),
        (1.0, 0.36, 0.15, 22.0),
    ),
    "cyclic": ((0.0, 0.74, 0.15, 25.0), (1.0, 0.74, 0.15, 385.0)),  # once around the hues
}
COLORMAPS = (*CONTROL_POINTS, "gray")
STEPS = 1024


@cache
def table(name: str) -> np.ndarray:
    """Return the colours of a map, uint8 of shape (1024, 3), from its low to its high end."""
    if name == "gray":  # sRGB bytes increase evenly, as in an image viewer
        return np.repeat(np.linspace(0, 255, STEPS).round().astype(np.uint8)[:, None], 3, axis=1)
    place, lightness, chroma, hue = np.array(CONTROL_POINTS[name]).T
    t = (np.arange(STEPS) + (0.5 if name == "cyclic" else 0.0)) / (
        STEPS if name == "cyclic" else STEPS - 1
    )
    light, most, angle = (np.interp(t, place, column) for column in (lightness, chroma, hue))
    low, high = np.zeros(STEPS), most.copy()  # bisect for the largest chroma that can be shown
    for _ in range(24):
        middle = 0.5 * (low + high)
        linear = _linear_rgb(light, middle, angle)
        shown = ((linear >= -1e-4) & (linear <= 1.0001)).all(axis=-1)
        low, high = np.where(shown, middle, low), np.where(shown, high, middle)
    fits = ((_linear_rgb(light, most, angle) >= 0) & (_linear_rgb(light, most, angle) <= 1)).all(-1)
    linear = _linear_rgb(light, np.where(fits, most, low), angle).clip(0.0, 1.0)
    srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    colours = np.round(255 * srgb).astype(np.uint8)
    colours.flags.writeable = False
    return colours


def _linear_rgb(light: np.ndarray, chroma: np.ndarray, hue: np.ndarray) -> np.ndarray:
    """Convert OKLab lightness, chroma and hue (degrees) to linear sRGB, by the matrices of [1]."""
    a, b = chroma * np.cos(np.deg2rad(hue)), chroma * np.sin(np.deg2rad(hue))
    cones = np.stack(
        (
            light + 0.3963377774 * a + 0.2158037573 * b,
            light - 0.1055613458 * a - 0.0638541728 * b,
            light - 0.0894841775 * a - 1.2914855480 * b,
        )
    )
    to_rgb = np.array(
        (
            (4.0767416621, -3.3077115913, 0.2309699292),
            (-1.2684380046, 2.6097574011, -0.3413193965),
            (-0.0041960863, -0.7034186147, 1.7076147010),
        )
    )
    return (to_rgb @ cones**3).T
