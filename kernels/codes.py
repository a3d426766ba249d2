"""Integer codes that kernels switch on, named once for the API and both kernel sets."""

from enum import IntEnum


class Border(IntEnum):
    """Border rules, named as in :mod:`scipy.ndimage`."""

    REFLECT = 0
    CONSTANT = 1
    NEAREST = 2
    MIRROR = 3
    WRAP = 4


class Norm(IntEnum):
    """Length of a gradient: ``|dx| + |dy|``, or the square root of ``dx^2 + dy^2``."""

    L1 = 0
    L2 = 1


class Thinning(IntEnum):
    """Where non-maximum suppression looks for the neighbours of a pixel along its gradient."""

    SECTORS = 0  # the nearest of four directions, as OpenCV
    INTERPOLATED = 1  # between two neighbours, as Canny 1986


class Edge(IntEnum):
    """State of a pixel between thinning and hysteresis."""

    NONE = 0
    WEAK = 1
    STRONG = 2


class Cost(IntEnum):
    """How unlike two pixels of a stereo pair are, or the windows around them."""

    SAD = 0
    SSD = 1
    BIRCHFIELD_TOMASI = 2
    ZNCC = 3
    CENSUS = 4
    CENSUS_SYMMETRIC = 5


# A window varies by nothing but rounding where its variance, against the mean of its squares, is
# at most this. The least variance of bytes, of a window of 33025, is 4.6e-10.
FLAT = 2.0**-40


class Subpixel(IntEnum):
    """Which curve through the costs around a winner tells a disparity's fraction."""

    NONE = 0
    PARABOLA = 1
    EQUIANGULAR = 2  # two lines of one slope, as absolute differences make


# atan(a) = a P(a^2) on [0, 1] within 1.4e-7 in float32: a minimax fit, lowest coefficient first.
# Sums and products only, so that an orientation has the same bits on every device.
ATAN = (
    0.9999993355361315,
    -0.3332986060035421,
    0.19946563377106752,
    -0.1390861734379522,
    0.09642164106383755,
    -0.055911847344499485,
    0.021862608447395723,
    -0.004054466052665892,
)

# cv2.Canny's sectors end at 22.5 and 67.5 degrees, in units of 2^-15: 13573 = tan(22.5 deg) 2^15.
SECTOR_ONE = 32768.0
SECTOR_LOW = 13573.0
SECTOR_HIGH = 79109.0  # tan(67.5 deg) = tan(22.5 deg) + 2

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
MAX_BINS = 8192  # of the minor axis of an ellipse, in the shared memory of a block
# Of a picture of points: the key of a sample that shows none, and the most samples across a point.
FAR = 2**63 - 1
LARGEST_SPLAT = 64.0


# Cost of a match: the weighed Hamming distance of two 5 x 5 census transforms, and the difference
# of two grey values, halved and limited.
CENSUS_BITS = 24
CENSUS_WEIGHT = 2
DIFFERENCE_SHIFT = 1
DIFFERENCE_LIMIT = 6
LARGEST_MATCH_COST = CENSUS_WEIGHT * CENSUS_BITS + DIFFERENCE_LIMIT


# What the hash of a corner multiplies its y and z by, not its x [Mueller et al. 2022].
HASH_PRIMES = 2654435761, 805459861

# Of radiance fields: densities are e^x for x up to this, opaque within any step; and gradients by x
# are cut off, as float16 ends at 65504.
MOST_LOG_DENSITY = 11.0
MOST_LOG_DENSITY_GRADIENT = 30000.0

# The two perceptrons of a hash field. The first makes a density and 15 numbers more, the second
# a colour of these 16 and 16 harmonics of the view; 13 numbers beside the colour mean nothing.
NETWORK_RECTIFIED = True, False, True, True, False
NETWORK_VALUES = 64, 16 + 16, 64, 64, 16  # that layers give, with the harmonics beside the second
NETWORK_PARTS = 264  # of sums over samples: two for each multiprocessor of the largest GPUs


def network_layers(inputs: int) -> tuple[tuple[int, int], ...]:
    """Return the inputs and outputs of the layers, in the order of their weights."""
    return (inputs, 64), (64, 16), (32, 64), (64, 64), (64, 16)


def network_room(inputs: int, samples: int, half: bool) -> tuple[int, int]:
    """Return the shape of the working memory, in float32, for products in half precision or not.

    In half precision layers stay in registers, and weights have gradients of parts of the samples;
    otherwise there are the values that layers give, and their gradients.
    """
    if half:
        return NETWORK_PARTS, sum(k * n for k, n in network_layers(inputs))
    return 2 * sum(NETWORK_VALUES), samples


class Background(IntEnum):
    """What a ray sees behind everything."""

    WHITE = 0
    BLACK = 1
    RANDOM = 2  # a colour of its own for each ray: nothing can be learnt from it
    LEARNT = 3


class Shape(IntEnum):
    """Solids of synthetic scenes, by the distance to their surfaces."""

    ELLIPSOID = 0  # half axes
    BOX = 1  # half sides, rounding
    TORUS = 2  # radius of the ring in its own x and y, radius of the tube
    CYLINDER = 3  # radius, half height along its own z, -, rounding


class Pattern(IntEnum):
    """Where the surface of a solid has its second colour."""

    PLAIN = 0
    CHECKS = 1  # in x and y
    RINGS = 2  # about z
    STRIPES = 3  # along z
