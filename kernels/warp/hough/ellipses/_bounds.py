"""The bounds of an ellipse, as a structure for the kernels of both devices."""

from typing import Any

import warp as wp


@wp.struct
class Bounds:
    """Bounds of the axes of an ellipse; see `codes.hough.EllipseBounds`."""

    least: float
    most: float
    narrow: float
    wide: float
    per_bin: float
    turn: float


def bounds_of(given: Any) -> Any:
    """Return the structure of an `EllipseBounds`."""
    made = Bounds()
    made.least, made.most, made.narrow, made.wide, made.per_bin, made.turn = given
    return made
