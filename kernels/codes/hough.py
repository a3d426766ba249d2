"""Constants of Hough transforms, numbers in fixed point, and arguments that travel together."""

from typing import Any, NamedTuple

# Directions are taken to the nearest of these over the full turn (0.022 degrees): floor of the
# angle times the factor, plus a half, in float32.
DIRECTIONS = 16384
DIRECTION_FACTOR = 2607.594482421875  # float32 of DIRECTIONS / (2 pi)

# The generalised Hough transform in integers. Vectors of a table are in 1/256 pixel; cosines and
# sines in 2^-20; turned vectors in 1/16 pixel; scales in 1/2048. So a turn fits into 64 bits, a
# scaled vector into 32 as long as it is shorter than 2^16 pixels.
VECTOR_ONE = 1 << 8
TURN_ONE = 1 << 20
TURNED_ONE = 1 << 4
SCALE_ONE = 1 << 11
TILE = 8  # cells along the side of what one peak is reported of

# Circles in integers. Lines are walked in 2^-15 of a cell; sums over the points of a circle have
# its normals in 2^-14, and distances from it in 2^-10 of a pixel.
LINE_ONE = 1 << 15
NORMAL_ONE = 1 << 14
FINE_ONE = 1 << 10
ARCS = 64  # parts of a circle that are counted apart: of each octant eight, by the slope
MAX_BINS = 8192  # for the minor axis of an ellipse, in the shared memory of a block


class LineTables(NamedTuple):
    """What takes a point to its bin at each angle: ``(x cosine + y sine + offset) >> shift``.

    Arrays of int32, int32 and int64, padded to a multiple of 8 angles.
    """

    cosine: Any
    sine: Any
    offset: Any
    shift: int


class LineWindows(NamedTuple):
    """Which angles a point votes for: by its direction, the first of them and their number.

    `orientation` is float32, one a point; the int32 tables have an entry for each direction code
    over half a turn.
    """

    orientation: Any
    first: Any
    number: Any


class Rings(NamedTuple):
    """Circles of several radii: offsets (M, 2) and their direction codes, one circle after another.

    `radii` (R,) and `starts` (R + 1,) say how large each is, and where its offsets begin.
    """

    radii: Any
    offsets: Any
    codes: Any
    starts: Any


class Aim(NamedTuple):
    """Which edge points count for a centre: those whose line passes near it, on one side or both.

    A line may pass at most ``slack + slope * distance`` beside the centre. Sides are 1, along the
    gradient, and -1, against it, from the first down to the last.
    """

    slack: float
    slope: float
    first_side: int
    last_side: int


class EllipseBounds(NamedTuple):
    """What an ellipse may be: bounds of the squared distance of a pair, and of the minor semi-axis.

    `narrow` and `wide` are squares too. The bin of a semi-axis is the nearest whole number of
    `per_bin` times it. Directions may be off by the sine whose square is `turn`; if that is
    negative they do not count.
    """

    least: float
    most: float
    narrow: float
    wide: float
    per_bin: float
    turn: float


class Voters(NamedTuple):
    """Edge points in the order of their directions: (2, N), and where each direction begins."""

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
    """The image that is voted in, and the side of a cell, ``2^shift`` pixels."""

    height: int
    width: int
    shift: int
