"""Codes of filters: borders, and the arc tangent of gradients."""

from enum import IntEnum
from typing import NamedTuple


class Border(IntEnum):
    """Border rules, named as in :mod:`scipy.ndimage`."""

    REFLECT = 0
    CONSTANT = 1
    NEAREST = 2
    MIRROR = 3
    WRAP = 4


class Outside(NamedTuple):
    """The values outside an image, for both passes of a derivative.

    `border` is a code of `Border`. With CONSTANT, `cval` is the value outside the image; `smooth`
    and `slope` are the values outside after a first pass with these taps.
    """

    border: int
    cval: float
    smooth: float
    slope: float


# Coefficients of P in atan(a) = a P(a^2) on [0, 1], lowest first: a minimax fit with an error below
# 1.4e-7 in float32. It has only sums and products, so an orientation has the same bits everywhere.
ATAN = (
    0.9999993355361315,
    -0.3332986060035421,
    0.19946563377106752,
    -0.1390861734379522,
    0.09642164106383755,
    -0.055911847344499485,
    0.021862608447395723,
    -0.004054466052665892,
)
