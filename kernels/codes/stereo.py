"""Codes of stereo: matching costs, sub-pixel fits, and arguments that travel together."""

from enum import IntEnum
from typing import Any, NamedTuple


class Cost(IntEnum):
    """Measures of the difference of two pixels of a stereo pair, or of the windows around them."""

    SAD = 0
    SSD = 1
    BIRCHFIELD_TOMASI = 2
    ZNCC = 3
    CENSUS = 4
    CENSUS_SYMMETRIC = 5


# A window counts as constant if its variance over the mean of its squares is at most this, because
# rounding errors reach it. The smallest such quotient of bytes, in a window of 33025, is 4.6e-10.
FLAT = 2.0**-40


class Subpixel(IntEnum):
    """The curve through the costs around a winner; its minimum is the sub-pixel disparity."""

    NONE = 0
    PARABOLA = 1
    EQUIANGULAR = 2  # two lines of opposite slope, because absolute differences grow linearly


# Cost of a match: CENSUS_WEIGHT times the Hamming distance of two 5 x 5 census transforms, plus the
# difference of the two grey values, halved, but at most DIFFERENCE_LIMIT.
CENSUS_BITS = 24
CENSUS_WEIGHT = 2
DIFFERENCE_SHIFT = 1
DIFFERENCE_LIMIT = 6
LARGEST_MATCH_COST = CENSUS_WEIGHT * CENSUS_BITS + DIFFERENCE_LIMIT

# Kernels number costs with 32 bits, and the disparities of a pixel with 16 bits, both signed.
MAX_COSTS = 2**31 - 1
MAX_DISPARITIES = 2**15


class Winners(NamedTuple):
    """The results for each pixel of the left image: arrays (H, W) that kernels fill."""

    index: Any
    """Index of the smallest cost, int32; -1 where it is not unique."""
    disparity: Any
    """Sub-pixel disparity, float32; NaN where it is not unique."""
    cost: Any
    """The smallest cost, float32."""
    confidence: Any
    """1 minus the smallest cost over the cost of its best rival, float32."""


class Rule(NamedTuple):
    """The rule by which the costs of a pixel give a disparity."""

    first: int
    """Disparity of the first cost, pixels."""
    subpixel: int
    """A `Subpixel`."""
    uniqueness: int
    """Per cent by which a winner must be below its best rival."""


class Penalties(NamedTuple):
    """The penalties of a change of disparity along a path."""

    near: int
    """P1: the penalty of a change by one pixel."""
    far: Any
    """P2: the penalty of a larger change, for each difference of the guide; (256,) uint16."""
    most: int
    """The largest P2 of the array."""


class View(NamedTuple):
    """One image of a pair, as input of the costs of semi-global matching."""

    bits: Any
    """Census of 5 x 5 pixels, (H, W) uint64."""
    gray: Any
    """Grey values, (H, W) uint8."""
