"""Codes of edges: norms, thinning, the states of pixels, and the digits of order statistics."""

import math
from enum import IntEnum


class Norm(IntEnum):
    """Length of a gradient: ``|dx| + |dy|``, or the square root of ``dx^2 + dy^2``."""

    L1 = 0
    L2 = 1


class Thinning(IntEnum):
    """The neighbours that non-maximum suppression compares a pixel with."""

    SECTORS = 0  # those in the nearest of four directions, as in OpenCV
    INTERPOLATED = 1  # interpolated along the gradient (Canny 1986); the first of a tie is kept
    FRAMED = 2  # the same; both of a tie are kept, none at the border, as in scikit-image


class Edge(IntEnum):
    """State of a pixel between thinning and hysteresis."""

    NONE = 0
    WEAK = 1
    STRONG = 2


# cv2.Canny's sectors end at 22.5 and 67.5 degrees. Tangents are in units of 2^-15:
# 13573 = tan(22.5 deg) 2^15.
SECTOR_ONE = 32768.0
SECTOR_LOW = 13573.0
SECTOR_HIGH = 79109.0  # tan(67.5 deg) = tan(22.5 deg) + 2

# Digits (shift, width) of a float32 >= 0: an order statistic is found by 11, 10 and 10 of its bits.
DIGITS = ((20, 11), (10, 10), (0, 10))
BINS = 2**11  # number of values of the longest of these digits

# Logarithm of a ratio of squared lengths. Its mantissa m in [sqrt(1/2), sqrt(2)) has the logarithm
# 2 s (1 + s^2 / 3 + s^4 / 5 + s^6 / 7 + s^8 / 9), s = (m - 1) / (m + 1), within 2e-9 of it.
LOG = (1.0, 1.0 / 3.0, 1.0 / 5.0, 1.0 / 7.0, 1.0 / 9.0)
LN2 = math.log(2.0)
LEAST_MANTISSA = 0x3F3504F3  # bits of sqrt(1/2) as float32
MANTISSA_BITS = 23
LEAST_RATIO = 1e-30  # smaller ratios move an edge by less than float32 can tell
