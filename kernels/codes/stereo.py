"""Codes of stereo: matching costs, sub-pixel disparities, and what its primitives take together."""

from enum import IntEnum
from typing import Any, NamedTuple


class Cost(IntEnum):
    """How unlike two pixels of a stereo pair are, or the windows around them."""

    SAD = 0
    SSD = 1
    BIRCHFIELD_TOMASI = 2
    ZNCC = 3
    CENSUS = 4
    CENSUS_SYMMETRIC = 5


# Largest quotient of a window's variance and the mean of its squares that is taken for rounding:
# the window is constant. The least quotient of bytes, in a window of 33025, is 4.6e-10.
FLAT = 2.0**-40


class Subpixel(IntEnum):
    """The curve through the costs around a winner whose lowest point is the disparity."""

    NONE = 0
    PARABOLA = 1
    EQUIANGULAR = 2  # two lines of opposite slope: absolute differences grow so


# Cost of a match: CENSUS_WEIGHT times the Hamming distance of two 5 x 5 census transforms, plus the
# difference of the two grey values, halved, but at most DIFFERENCE_LIMIT.
CENSUS_BITS = 24
CENSUS_WEIGHT = 2
DIFFERENCE_SHIFT = 1
DIFFERENCE_LIMIT = 6
LARGEST_MATCH_COST = CENSUS_WEIGHT * CENSUS_BITS + DIFFERENCE_LIMIT

# Kernels count costs, and the places of disparities, by 32 and by 16 bits with a sign.
MAX_COSTS = 2**31 - 1
MAX_DISPARITIES = 2**15


class Winners(NamedTuple):
    """What is found for each pixel of the left image: arrays (H, W) that kernels fill."""

    index: Any
    """Place of the least cost, int32; -1 where it is not unique."""
    disparity: Any
    """Pixels, between whole ones; float32, NaN where it is not unique."""
    cost: Any
    """The least cost, float32."""
    confidence: Any
    """1 less the quotient of the least cost and of its best rival; float32."""


class Rule(NamedTuple):
    """How the costs of a pixel become a disparity."""

    first: int
    """Disparity of the first cost, pixels."""
    subpixel: int
    """A `Subpixel`."""
    uniqueness: int
    """By how many per cent a winner must be below its best rival."""


class Penalties(NamedTuple):
    """What a change of disparity along a path costs."""

    near: int
    """By one pixel: P1."""
    far: Any
    """By more: P2 for each difference of the guide's values, an array (256,) of uint16."""
    most: int
    """The largest P2 of the array."""


class View(NamedTuple):
    """One image of a pair, as semi-global matching compares it."""

    bits: Any
    """Census of 5 x 5 pixels, (H, W) uint64."""
    gray: Any
    """Grey values, (H, W) uint8."""
