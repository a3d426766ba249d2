"""Codes and constants of radiance fields."""

from enum import IntEnum

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
