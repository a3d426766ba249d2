"""What kernels of bundle adjustment take and give, and their constants."""

from enum import IntEnum
from typing import Any, NamedTuple

NEAREST = 2.0**-20  # least depth of a point before a camera, in units of the world
BEHIND = 1e3  # pixels: the residual, in x and in y, of a point that is not before its camera
FLATTEST = 2.0**-100  # added to the diagonal of a point's equations, so that they have a solution
POSE = 6  # parameters of a pose: a turn about the camera's axes, then a shift along them
# Parameters of a view: a pose; the logarithm of both focal lengths; k1, k2; the principal point.
SIZES = (6, 7, 9, 11)
# Sightings whose costs are joined to one number: of Cauchy's loss, the product of 1 + (r / c)^2.
JOINED = 8


class Loss(IntEnum):
    """How the cost grows with a residual r, for a scale c."""

    SQUARED = 0  # r^2 / 2
    HUBER = 1  # linear beyond c
    CAUCHY = 2  # c^2 / 2 log(1 + (r / c)^2)


class Scenery(NamedTuple):
    """Cameras and points, as kernel arrays."""

    views: Any
    """(C, 12) float64: the rotation row by row, then the translation, X = R W + t."""
    lenses: Any
    """(L, 9) float64: fx, fy, cx, cy, k1, k2, p1, p2, k3 of OpenCV's model."""
    points: Any
    """(P, 3) float64."""


class Sightings(NamedTuple):
    """Where views see points, as kernel arrays: in the order of the points."""

    where: Any
    """(O, 2) float64: x, y in pixels."""
    ends: Any
    """(O, 3) int32: the view, its lens, and the point."""
    spans: Any
    """(P, 2) int32: first sighting of a point, and the number of them."""
    order: Any
    """(O,) int32: the sightings of the first view, ascending, then those of the next."""
    ranges: Any
    """(C, 2) int32: first place of a view in `order`, and the number of its sightings."""


class Slopes(NamedTuple):
    """Residuals and their derivatives, as kernel arrays."""

    slopes: Any
    """(O, 2, 3 + K) float64: by the point, then by the K parameters of the view."""
    gaps: Any
    """(O, 2) float64: projected less seen, pixels."""
    weights: Any
    """(O,) float64: of the squares of the residuals."""


class Eliminated(NamedTuple):
    """What is left of the equations of points, as kernel arrays."""

    inverses: Any
    """(P, 6) float64: the inverse of a point's equations: xx, xy, xz, yy, yz, zz."""
    pulls: Any
    """(P, 3) float64: this inverse times the point's gradient."""


class Blocks(NamedTuple):
    """Pairs of views that see the same points, each with itself too, as kernel arrays."""

    views: Any
    """(B, 2) int32: a view, and itself or a later one; sorted."""
    number: Any
    """(C, C) int32: which row of `views` has these two views; -1 where none has."""


class Condensed(NamedTuple):
    """The equations of the views without points, as kernel arrays."""

    system: Any
    """(B, K, K) float64: parameters of the first view of each block by those of the second."""
    right: Any
    """(C, K) float64: the gradient."""
    sizes: Any
    """(C, K) float64: the diagonal before points were eliminated."""
