"""Constants that decide bits: of robust fits, and of the corners of chessboards."""

from enum import IntEnum
from typing import Any, NamedTuple


class Model(IntEnum):
    """What is fitted to matches."""

    SIMILARITY = 0
    AFFINE = 1
    HOMOGRAPHY = 2
    FUNDAMENTAL = 3
    PARALLAX = 4  # a fundamental matrix of a known plane and of two matches off it
    ESSENTIAL = 5  # a fundamental matrix of two known cameras
    POSE = 6  # a known camera before a scene: two rows of R, then t


class Given(NamedTuple):
    """The matches of several pairs, where kernels find them."""

    matches: Any
    """x0, y0, x1, y1, and z0 of a scene, (4 or 5, M) float32."""
    spans: Any
    """First and number of the matches of each pair, (P, 2) int32."""
    squares: Any
    """The square of the threshold of each pair, (P,) float32."""
    known: Any
    """(P, K) float64, or of any size where a model needs none. PARALLAX: the homography of a plane.
    ESSENTIAL: from points of either image to rays, and back, four matrices of 3 x 3. POSE: from
    rays to points, and back."""


class Draw(NamedTuple):
    """Which samples are drawn."""

    kind: int
    """A `Model`."""
    seed: int
    first: int
    """The first hypothesis."""


SAMPLE = (2, 3, 4, 7, 2, 5, 3)  # matches of a sample, by model

GROUP = 64  # hypotheses, of which the one with the least preview is scored on all matches
PREVIEW = 64  # matches at most
LANES = 32  # partial sums: match i is in sum i mod LANES
DRAWS = 16  # times that a match may be drawn until it is another than those before it
COST_ONE = 1 << 12  # the cost of an outlier; 2^19 of them fit into 31 bits
MAX_MATCHES = 1 << 18  # matches of a pair
NO_COST = (1 << 31) - 1  # no model
# Twice the area of a triangle, over the square of half the picture: flatter ones fix no map.
FLAT = 1e-4
# Sums of a least-squares step: of maps 6 products of (x, y, 1) / w by 4 factors and 9 residuals,
# of epipolar geometries 45 products of derivatives and 9 residuals, of poses 21 and 6.
SUMS = (33, 33, 33, 54, 54, 54, 27)

# Pixels along a row for which the place through a lens may be a parabola through three places.
LENS_SEGMENT = 32

# Chessboards.
LUMA = (0.2125, 0.7154, 0.0721)  # weights of red, green, blue in a grey picture
EDGE_REACH, EDGE_ENTRIES = 5.0, 1281  # standard deviations that the table of an edge covers
CORNER_STEPS = 10  # Gauss-Newton steps of a corner's place at most
CORNER_STILL = 2e-3  # pixels along a side: a step that is smaller is the last
# Window of a corner: so much of the way to its neighbours, and pixels along an edge at most.
CORNER_SHARE, CORNER_FARTHEST = 0.7, 20.0
