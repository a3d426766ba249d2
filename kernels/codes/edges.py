"""Codes of edges: norms, thinning, the states of pixels, and the digits of order statistics."""

from enum import IntEnum


class Norm(IntEnum):
    """Length of a gradient: ``|dx| + |dy|``, or the square root of ``dx^2 + dy^2``."""

    L1 = 0
    L2 = 1


class Thinning(IntEnum):
    """Where non-maximum suppression looks for the neighbours of a pixel along its gradient."""

    SECTORS = 0  # the nearest of four directions, as OpenCV
    INTERPOLATED = 1  # between two neighbours, as Canny 1986; of a tie the first is kept
    FRAMED = 2  # the same; both of a tie are kept, and none on the frame, as scikit-image


class Edge(IntEnum):
    """State of a pixel between thinning and hysteresis."""

    NONE = 0
    WEAK = 1
    STRONG = 2


# cv2.Canny's sectors end at 22.5 and 67.5 degrees, in units of 2^-15: 13573 = tan(22.5 deg) 2^15.
SECTOR_ONE = 32768.0
SECTOR_LOW = 13573.0
SECTOR_HIGH = 79109.0  # tan(67.5 deg) = tan(22.5 deg) + 2

# A float32 >= 0 is found by its bits, 11 and then 10 and 10 of them at a time: (shift, width).
DIGITS = ((20, 11), (10, 10), (0, 10))
BINS = 2**11  # values that the longest of these digits has
