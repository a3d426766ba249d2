"""Constants of robust fits and of chessboards, which both kernel sets share."""

from enum import IntEnum
from typing import Any, NamedTuple


class Model(IntEnum):
    """The kinds of models that are fitted to matches."""

    SIMILARITY = 0
    AFFINE = 1
    HOMOGRAPHY = 2
    FUNDAMENTAL = 3
    PARALLAX = 4  # a fundamental matrix of a known plane and of two matches off it
    ESSENTIAL = 5  # a fundamental matrix of two known cameras
    POSE = 6  # a known camera before a scene: two rows of R, then t


class Given(NamedTuple):
    """The matches of several pairs of images, as kernel arrays."""

    matches: Any
    """Rows x0, y0, x1, y1, and for POSE also z0, (4 or 5, M) float32."""
    spans: Any
    """First match and number of matches of each pair, (P, 2) int32."""
    squares: Any
    """The square of the threshold of each pair, (P,) float32."""
    known: Any
    """Known numbers of each pair, (P, K) float64; of any size if a model needs none. PARALLAX: the
    homography of a plane. ESSENTIAL: four matrices of 3 x 3, from points of the first and of the
    second image to rays, and back. POSE: two matrices, from rays to points, and back."""


class Draw(NamedTuple):
    """The samples to draw."""

    kind: int
    """A `Model`."""
    seed: int
    first: int
    """The first hypothesis."""


SAMPLE = (2, 3, 4, 7, 2, 5, 3)  # matches of a sample, by model

GROUP = 64  # hypotheses, of which the one with the smallest preview is scored on all matches
PREVIEW = 64  # largest number of matches of a preview
LANES = 32  # partial sums: match i is in sum i mod LANES
DRAWS = 16  # attempts to draw a match that differs from those before it
COST_ONE = 1 << 12  # the cost of an outlier; 2^19 of them fit into 31 bits
MAX_MATCHES = 1 << 18  # matches of a pair
NO_COST = (1 << 31) - 1  # the cost if there is no model
# Smallest area of a triangle that fixes a map: twice the area, over the square of half the image.
FLAT = 1e-4
# Sums of a least-squares step: of maps 6 products of (x, y, 1) / w by 4 factors and 9 residuals,
# of epipolar geometries 45 products of derivatives and 9 residuals, of poses 21 and 6.
SUMS = (33, 33, 33, 54, 54, 54, 27)

# Pixels along a row for which the place through a lens may be a parabola through three places.
LENS_SEGMENT = 32

# Chessboards.
LUMA = (0.2125, 0.7154, 0.0721)  # weights of red, green and blue in grey
EDGE_REACH, EDGE_ENTRIES = 5.0, 1281  # reach of the table of an edge, in standard deviations
CORNER_STEPS = 10  # largest number of Gauss-Newton steps of a corner
CORNER_STILL = 2e-3  # pixels; a smaller step is the last one
# Window of a corner: share of the way to its neighbours, and largest reach along an edge, pixels.
CORNER_SHARE, CORNER_FARTHEST = 0.7, 20.0
