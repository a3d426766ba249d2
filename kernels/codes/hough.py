"""Constants of Hough transforms, fixed-point units, and arguments that travel together."""

from typing import Any, NamedTuple

# Number of direction codes over the full turn (0.022 degrees each). The code of an angle is
# floor(angle * factor + 1/2), in float32.
DIRECTIONS = 16384
DIRECTION_FACTOR = 2607.594482421875  # float32 of DIRECTIONS / (2 pi)

# Units of the generalised Hough transform in integers: 1/256 pixel for the vectors of a table,
# 2^-20 for cosines and sines, 1/16 pixel for rotated vectors, 1/2048 for scales. So the products of
# a rotation fit into 64 bits, and a scaled vector shorter than 2^16 pixels into 32 bits.
VECTOR_ONE = 1 << 8
TURN_ONE = 1 << 20
TURNED_ONE = 1 << 4
SCALE_ONE = 1 << 11
TILE = 8  # cells along the side of a tile, for which one peak is reported

# Units of circles in integers: 2^-15 of a cell for steps along a line. In the sums over the points
# of a circle, 2^-14 for its normals and 2^-10 pixel for distances from it.
LINE_ONE = 1 << 15
NORMAL_ONE = 1 << 14
FINE_ONE = 1 << 10
ARCS = 64  # arcs of a circle, counted separately: eight per octant, of equal steps of the slope
STEPS = 1 << 16  # units of a pixel in steps along a line from pixel to pixel
FARTHEST = 2.0**17  # pixels: no place along a line is farther from its origin
PLACES = 2.0**14  # steps of a pixel by which points along a line are sorted
DENSITY = 0.6  # least points per pixel of a segment; a thin edge has 0.7 to 1
PARTIAL = 32  # sums of a run of points that are added side by side, then to one another
MAX_BINS = 8192  # bins of the minor axis of an ellipse that fit into a block's shared memory


class LineTables(NamedTuple):
    """Tables for the bin of a point at each angle: ``(x cosine + y sine + offset) >> shift``.

    Arrays of int32, int32 and int64, padded to a multiple of 8 angles.
    """

    cosine: Any
    sine: Any
    offset: Any
    shift: int


class LineWindows(NamedTuple):
    """The angles that a point votes for, by its direction: the first one, and their number.

    `orientation` is float32, one per point; the int32 tables have an entry for each direction code
    over half a turn.
    """

    orientation: Any
    first: Any
    number: Any


def most_peaks(shape: tuple[int, int], apart: tuple[int, int]) -> int:
    """Return how many peaks of an accumulator of `shape` can be more than `apart` from one another.

    A block of bins has one at most.
    """
    return -(-shape[0] // (apart[0] + 1)) * -(-shape[1] // (apart[1] + 1))


class Rings(NamedTuple):
    """Circles of several radii: offsets (M, 2) and their direction codes, circle by circle.

    `radii` (R,) and `starts` (R + 1,) are the radius of each circle and the index of its first
    offset.
    """

    radii: Any
    offsets: Any
    codes: Any
    starts: Any


class Aim(NamedTuple):
    """The condition for an edge point to support a centre: its line passes near the centre.

    The distance of the line from the centre is at most ``slack + slope * distance``. Side 1 is
    along the gradient, side -1 against it; the sides run from the first down to the last.
    """

    slack: float
    slope: float
    first_side: int
    last_side: int


class SegmentRule(NamedTuple):
    """What a segment of the progressive Hough transform needs."""

    threshold: int
    """Votes for its line."""
    line_length: int
    """Pixels from one end to the other, along the longer side."""
    line_gap: int
    """Most empty pixels between two set ones."""


class EllipseBounds(NamedTuple):
    """Bounds of an ellipse: of the squared distance of its pair, and of its minor semi-axis.

    `narrow` and `wide` are squares too. The bin of a semi-axis is `per_bin` times it, rounded.
    `turn` is the squared sine of the largest error of a direction; if it is negative, directions
    are ignored.
    """

    least: float
    most: float
    narrow: float
    wide: float
    per_bin: float
    turn: float


class Voters(NamedTuple):
    """Edge points sorted by direction, (2, N), and the index at which each direction begins."""

    points: Any
    starts: Any


class Entries(NamedTuple):
    """A shape: the vectors (N, 2) from its boundary to its centre, and their direction codes."""

    vectors: Any
    directions: Any


class Slices(NamedTuple):
    """Poses to vote for: rotations as code, cosine and sine (R, 3), and scales (S,)."""

    turns: Any
    scales: Any


class Cells(NamedTuple):
    """The size of the image, and the side of a cell, ``2^shift`` pixels."""

    height: int
    width: int
    shift: int
