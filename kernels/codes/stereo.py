"""Codes of stereo: matching costs and sub-pixel disparities."""

from enum import IntEnum


class Cost(IntEnum):
    """How unlike two pixels of a stereo pair are, or the windows around them."""

    SAD = 0
    SSD = 1
    BIRCHFIELD_TOMASI = 2
    ZNCC = 3
    CENSUS = 4
    CENSUS_SYMMETRIC = 5


# A window varies by nothing but rounding where its variance, against the mean of its squares, is
# at most this. The least variance of bytes, of a window of 33025, is 4.6e-10.
FLAT = 2.0**-40


class Subpixel(IntEnum):
    """Which curve through the costs around a winner tells a disparity's fraction."""

    NONE = 0
    PARABOLA = 1
    EQUIANGULAR = 2  # two lines of one slope, as absolute differences make


# Cost of a match: the weighed Hamming distance of two 5 x 5 census transforms, and the difference
# of two grey values, halved and limited.
CENSUS_BITS = 24
CENSUS_WEIGHT = 2
DIFFERENCE_SHIFT = 1
DIFFERENCE_LIMIT = 6
LARGEST_MATCH_COST = CENSUS_WEIGHT * CENSUS_BITS + DIFFERENCE_LIMIT
