"""Directions as integers: an angle has the same code on every device."""

import warp as wp

from cvkern.kernels.codes.hough import DIRECTION_FACTOR, DIRECTIONS

FACTOR = wp.constant(DIRECTION_FACTOR)
LAST = wp.constant(DIRECTIONS - 1)


@wp.func
def direction_code(angle: float) -> int:
    """Return the nearest direction code; only for modules compiled without `fuse_fp`."""
    return int(wp.floor(angle * FACTOR + 0.5)) & LAST
