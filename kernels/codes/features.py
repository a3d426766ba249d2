"""Constants of features: scale space, histograms of directions, matching."""

import math
from enum import IntEnum
from typing import Any, NamedTuple


class Corner(IntEnum):
    """Measures of a corner, from its structure tensor A."""

    HARRIS = 0  # det(A) - k trace(A)^2
    NOBLE = 1  # 2 det(A) / (trace(A) + eps)
    SHI_TOMASI = 2  # the smaller eigenvalue


MARGIN = 5  # smallest distance of keypoints from the border, pixels [Lowe 2004]
MOVES = 5  # largest number of moves of a keypoint to the next pixel
WORD = 32  # pixels of a row whose marks are the bits of one word

# Histograms are sums of integers. A contribution is the length of a gradient, clipped to LONGEST
# (differences in images of [0, 1] are at most sqrt(2)), times a weight, times a power of two.
LONGEST = 1.5
BINS = 36  # directions of the histogram of an orientation
PEAKS = 4  # largest number of orientations of a point
BINS_PER_RADIAN = BINS / (2 * math.pi)
CELLS = 4  # cells along the side of a descriptor
DIRECTIONS = 8  # directions of each cell
DIRECTIONS_PER_RADIAN = DIRECTIONS / (2 * math.pi)
ROOM = (CELLS + 2) * (CELLS + 2) * (DIRECTIONS + 1)  # with a margin of cells, and the first again
REACH = 127  # largest distance from a point to the end of its window, pixels
LARGEST_SHARE = 0.2  # share of a descriptor's length that one number may have [Lowe 2004]
DESCRIPTOR_ONE = 512.0

# exp(-x) = (1 - y (1 - y / 2 (1 - y / 3 (...))))^16 for y = x / 16 <= 1 / 2, within 3e-7.
DECAY_TERMS = 7

ORIENTATION_SIGMA = 1.5  # sigma of the window of an orientation, in scales of the point
CELL_SIDE = 3.0  # side of a cell of a descriptor, in scales of the point
EXP_TERMS, COS_TERMS = 30, 17  # terms of series, enough for float64 up to e^2.1 and cos(4)


class Limits(NamedTuple):
    """What a keypoint must have."""

    threshold: float
    """The difference of levels at its pixel is above this."""
    contrast: float
    """Least height of the fit."""
    edge: float
    """Its tr^2 / det is below this."""


class Scales(NamedTuple):
    """Sizes of the scale space."""

    sigma: float
    """That of the first level of an octave, in its pixels."""
    levels: int
    """Levels with extrema in an octave."""
    step: float
    """A pixel of the first octave, in pixels of the image."""


class Points(NamedTuple):
    """Keypoints before the best are chosen, as kernel arrays."""

    cells: Any
    """Octave, level, row and column, (N, 4) int32."""
    offsets: Any
    """Row, column and level from there, and the response, (N, 4) float32."""
    points: Any
    """Row and column in the image, (N, 2) float32."""
    values: Any
    """The response as an integer, or -1 of points to leave out, (N,) int32."""
    squares: Any
    """Squares of a grid, (N,) int32."""


class Settled(NamedTuple):
    """Keypoints with an orientation, as kernel arrays."""

    windows: Any
    """Octave, level, row, column and radius, (N, 5) int32."""
    turns: Any
    """Cosine and sine over a cell's side, angle, and 1 / (2 sigma^2), (N, 4) float32."""
    points: Any
    """(N, 2) float32."""
    scales: Any
    """(N,) float32, in pixels of the image."""
    orientations: Any
    """(N,) float32, radians."""
    responses: Any
    """(N,) float32."""


GRAY = (0.2125, 0.7154, 0.0721)  # Rec. 709, as skimage.color.rgb2gray
MOST_GRAY = 1e15  # times white; squares of larger values would overflow float32


def decay_factors() -> tuple[float, ...]:
    """Return 1 / 7, 1 / 6, ..., 1 / 2, the factors of the series from its inner end."""
    return tuple(1.0 / n for n in range(DECAY_TERMS, 1, -1))


# Squared distances of 128 bytes are at most 128 * 255^2 = 8.3e6.
FARTHEST = 2**30  # distance that stands for a missing descriptor
BLOCK_ROWS = 64  # rows of descriptors that are matched at a time
MOST_BYTES = 4096  # largest size of a descriptor: squared distances stay below half of FARTHEST

# ORB: the circle of FAST corners (row, column), of whose 16 pixels 9 decide; then the disc whose
# moments give a direction, and the comparisons of pairs of pixels in a turned pattern.
# Weights of rows and columns of a smaller size, and of the Gaussian, are integers.
CIRCLE = ((-3, 0), (-3, 1), (-2, 2), (-1, 3), (0, 3), (1, 3), (2, 2), (3, 1),
          (3, 0), (3, -1), (2, -2), (1, -3), (0, -3), (-1, -3), (-2, -2), (-3, -1))  # fmt: skip
SHARES = 128  # sum of the weights of a pixel of a smaller size, in each direction
DISC = 15  # radius, pixels
BLUR_TAPS = (18, 34, 48, 56, 48, 34, 18)  # OpenCV's Gaussian, sigma 2, before pixels are compared
BLUR = len(BLUR_TAPS) // 2  # its radius
PATTERN_REACH = 18  # largest distance of a pixel that is compared, along an axis
PATTERN_PITCH = 64  # a place of the pattern is this times its row, plus its column
TURNS = 64  # directions of the pattern
PAIRS = 256  # pairs of pixels, and bits of a descriptor
TURNS_PER_RADIAN = TURNS / (2 * math.pi)
