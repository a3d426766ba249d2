"""Directions as integers: the same code of an angle on every device."""

import warp as wp

from cvkern.kernels.codes.hough import DIRECTION_FACTOR, DIRECTIONS

FACTOR = wp.constant(DIRECTION_FACTOR)
LAST = wp.constant(DIRECTIONS - 1)


@wp.func
def direction_code(angle: float) -> int:
    """Return the nearest of DIRECTIONS over the full turn; for modules without `fuse_fp`."""
    return int(wp.floor(angle * FACTOR + 0.5)) & LAST
