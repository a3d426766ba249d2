"""Codes and constants of radiance fields."""

from enum import IntEnum
from typing import Any, NamedTuple

# What the hash of a corner multiplies its y and z by, not its x [Mueller et al. 2022].
HASH_PRIMES = 2654435761, 805459861

# Densities are e^x for x up to this, opaque within any step. Gradients by x are cut off, because
# float16 ends at 65504.
MOST_LOG_DENSITY = 11.0
MOST_LOG_DENSITY_GRADIENT = 30000.0

# The two perceptrons of a hash field. The first makes a density and 15 numbers more, the second
# a colour of these 16 and 16 harmonics of the view; 13 numbers beside the colour mean nothing.
NETWORK_RECTIFIED = True, False, True, True, False
NETWORK_VALUES = 64, 16 + 16, 64, 64, 16  # results of layers; harmonics are beside the second
NETWORK_PARTS = 264  # parts of a sum over samples: two for each multiprocessor of large GPUs


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


class Draw(IntEnum):
    """What a random number is drawn for: each has a stream of its own."""

    PIXEL = 0  # the pixel that a ray of training goes through
    CELL_X = 1  # the point of its cell where a density is looked at
    CELL_Y = 2
    CELL_Z = 3
    JITTER = 4  # the distance of a ray's first sample behind its entry
    RED = 5  # the colour behind a ray
    GREEN = 6
    BLUE = 7
    CELL = 8  # the cell that is looked at
    PIXEL_Y = 9  # the point of its pixel that a ray goes through
    PIXEL_X = 10


class Rays(NamedTuple):
    """A batch of rays, as kernel arrays with room for R."""

    origins: Any
    """(R, 3) float32."""
    directions: Any
    """Unit vectors, (R, 3) float32."""
    active: Any
    """How many of them there are, (1,) int32; a field lowers it to those that it has room for."""


class Seen(NamedTuple):
    """What rays see before any background, or gradients of it; kernel arrays."""

    color: Any
    """(R, 3) float32."""
    opacity: Any
    """(R,) float32."""
    depth: Any
    """Sum of the distances of the samples, each by its weight, (R,) float32."""
    distortion: Any
    """How far the weights are spread along the ray, as in mip-NeRF 360, (R,) float32."""


class Space(NamedTuple):
    """Which cells of space are looked at."""

    bits: Any
    """A bit for each of the cells^3 cells of each level, (levels cells^3 / 32,) uint32."""
    levels: int
    """Cubes, each twice as large as the one before and around the same middle."""
    cells: int
    """Cells along a side, a multiple of 4."""
    unbounded: bool
    """Whether the cube of the field is all of space, contracted."""


class March(NamedTuple):
    """Where on its way through space a ray has samples."""

    near: float
    far: float
    finest: float
    """The distance between samples near the camera."""
    cone: float
    """The share of the distance that it is farther away."""
    most: int
    """Samples of a ray, at most."""
    jittered: bool
    """Whether the first one is at a random place of its step, or in the middle."""
    seed: int
    step: Any
    """Number of the training step, (1,) int32."""


class Samples(NamedTuple):
    """Samples of rays, as kernel arrays with room for M."""

    positions: Any
    """In the cube of the field from 0 to 1, (M, 3) float32."""
    distances: Any
    """Distance from the camera, and length of the step, (M, 2) float32."""
    rays: Any
    """The ray of each, (M,) int32."""


class Grid(NamedTuple):
    """A grid of density and colour."""

    density: Any
    """Raw densities, (N + 1, N + 1, N + 1) float32."""
    color: Any
    """Coefficients of each channel in turn, (N + 1, N + 1, N + 1, C) float32, C = 16 or 32."""
    basis: int
    """Coefficients of a channel: 1, 4 or 9."""
    least: float
    """The raw density below which there is nothing."""


class Rule(NamedTuple):
    """How Adam steps."""

    beta1: float
    beta2: float
    epsilon: float
    decay: float = 0.0
    """The share of each number that is added to its gradient."""
    sparse: bool = False
    """Whether numbers of gradient 0 and their means stay as they are."""


class Learnt(NamedTuple):
    """Numbers that are learnt, with what Adam keeps of their gradients; kernel arrays, (N,)."""

    gradients: Any
    mean: Any
    square: Any
    weights: Any


class Comparison(NamedTuple):
    """How colours are held against photographs."""

    kind: int
    """A Background."""
    learnt: Any
    """The colour of the learnt kind, (3,) float32."""
    huber: float
    """Where Huber's loss becomes linear; the loss is squared if this is 0."""
    scale: float
    """What gradients are multiplied by."""
    seed: int
    step: Any
    """Number of the training step, (1,) int32."""


class Views(NamedTuple):
    """Rays of a view on their way; kernel arrays."""

    at: Any
    """The distance where each goes on, (R,) float32."""
    taken: Any
    """Samples that it took, (R,) int32."""
    color: Any
    """What it saw so far: as in :class:`Seen`, (R, 3) float32."""
    opacity: Any
    """(R,) float32."""
    depth: Any
    """(R,) float32."""


class CameraSet(NamedTuple):
    """Cameras of one size."""

    poses: Any
    """Camera to world, (N, 3, 4) float32."""
    lenses: Any
    """fx, fy, cx, cy, k1, k2, p1, p2, k3 in OpenCV's order and meaning, (N, 9) float32."""
    width: int
    """Of each view, in pixels."""
    height: int


class Solids(NamedTuple):
    """S solids of a synthetic scene; kernel arrays."""

    kinds: Any
    """The Shape and the Pattern, (S, 2) int32."""
    placements: Any
    """The axes, each a row, and the middle, (S, 12) float32."""
    sizes: Any
    """What Shape says, (S, 4) float32."""
    paints: Any
    """Two colours, gloss, and parts of the pattern per length, (S, 8) float32."""
