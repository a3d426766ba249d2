"""The bounds of an ellipse, as a structure for the kernels of both devices."""

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
