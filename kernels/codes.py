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
