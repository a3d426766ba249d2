"""Codes and constants of radiance fields."""

from enum import IntEnum
from typing import Any, NamedTuple

# Factors of y and z in the hash of a corner; the factor of x is 1 [Mueller et al. 2022].
HASH_PRIMES = 2654435761, 805459861

# A density is e^x for x up to this value, which is opaque within any step. Larger x are clamped,
# because float16 ends at 65504.
MOST_LOG_DENSITY = 11.0
MOST_LOG_DENSITY_GRADIENT = 30000.0

# The two perceptrons of a hash field. The first computes a density and 15 more numbers, the second
# a colour from these 16 and 16 harmonics of the view. Its other 13 outputs are not used. In light
# that changes, the 16 numbers of a photograph's light follow the harmonics.
NETWORK_RECTIFIED = True, False, True, True, False
NETWORK_PARTS = 264  # partial sums over samples: two for each multiprocessor of large GPUs
LIGHT = 16  # numbers of a photograph's light
LIGHT_COLUMN = 16 + 16  # the first of them, among the inputs of the second perceptron
LIGHT_PARTS = 64  # partial sums over the rays of a batch, for each photograph


def network_values(lit: bool) -> tuple[int, ...]:
    """Return the numbers of values of the layers; the second includes harmonics and light."""
    return 64, LIGHT_COLUMN + LIGHT * lit, 64, 64, 16


def network_layers(inputs: int, lit: bool = False) -> tuple[tuple[int, int], ...]:
    """Return the inputs and outputs of the layers, in the order of their weights."""
    return (inputs, 64), (64, 16), (LIGHT_COLUMN + LIGHT * lit, 64), (64, 64), (64, 16)


def network_room(inputs: int, samples: int, half: bool, lit: bool = False) -> tuple[int, int]:
    """Return the shape of the working memory, in float32, for products in half precision or not.

    In half precision, values stay in registers, and the memory holds partial gradients of the
    weights. Otherwise it holds the values of the layers and their gradients.
    """
    if half:
        return NETWORK_PARTS, sum(k * n for k, n in network_layers(inputs, lit))
    return 2 * sum(network_values(lit)), samples


class NetworkInputs(NamedTuple):
    """The inputs of the two perceptrons of a hash field; kernel arrays."""

    features: Any
    """(M, K) float32 or float16, K = 16, 32, 48 or 64; K up to 48 with lights."""
    directions: Any
    """Viewing directions, (R, 3) float32."""
    rays: Any
    """The ray of each sample, (M,) int32."""
    total: Any
    """Number of the samples, (1,) int32."""
    weights: Any
    """Weights of all layers, (W,), with the dtype of the features."""
    table: Any = None
    """The lights of photographs, (N, 16) float32, or None."""
    views: Any = None
    """The photograph of each ray, (R,) int32, or None."""


# Numbers in an array of planes before the inverse depths of the planes: a pose from world to camera
# row by row, then how texels follow from places at depth 1: two factors, and two shifts.
PLANES_PLACE = 16


class Background(IntEnum):
    """The background of a ray."""

    WHITE = 0
    BLACK = 1
    RANDOM = 2  # a random colour for each ray, which cannot be learnt
    LEARNT = 3


# Speckles are cubes of three sizes: the fewest of them per unit of length, and the growth factor.
FEWEST_CUBES, MORE_CUBES = 9.0, 2.25


class Shape(IntEnum):
    """Solids of synthetic scenes, by the distance to their surfaces."""

    ELLIPSOID = 0  # half axes
    BOX = 1  # half sides, rounding
    TORUS = 2  # radius of the ring in its own x and y, radius of the tube
    CYLINDER = 3  # radius, half height along its own z, -, rounding


class Pattern(IntEnum):
    """The pattern of the second colour on the surface of a solid."""

    PLAIN = 0
    CHECKS = 1  # in x and y
    RINGS = 2  # about z
    STRIPES = 3  # along z


class Draw(IntEnum):
    """The purpose of a random number; each purpose has its own stream."""

    PIXEL = 0  # the pixel that a ray of training goes through
    CELL_X = 1  # the point of a cell at which the density is evaluated
    CELL_Y = 2
    CELL_Z = 3
    JITTER = 4  # the distance of a ray's first sample from its entry
    RED = 5  # the background of a ray
    GREEN = 6
    BLUE = 7
    CELL = 8  # the cell that is updated
    PIXEL_Y = 9  # the point of the pixel that a ray goes through
    PIXEL_X = 10


class Rays(NamedTuple):
    """A batch of rays, as kernel arrays with room for R."""

    origins: Any
    """(R, 3) float32."""
    directions: Any
    """Unit vectors, (R, 3) float32."""
    active: Any
    """Number of rays, (1,) int32; a field lowers it to the number that it has room for."""


class Composited(NamedTuple):
    """The composited rays, without a background, or gradients by them; kernel arrays."""

    color: Any
    """(R, 3) float32."""
    opacity: Any
    """(R,) float32."""
    depth: Any
    """Weighted sum of the distances of the samples, (R,) float32."""
    distortion: Any
    """Spread of the weights along the ray, as in mip-NeRF 360, (R,) float32."""


class Space(NamedTuple):
    """The cells of space that are not empty."""

    bits: Any
    """A bit for each of the cells^3 cells of each level, (levels cells^3 / 32,) uint32."""
    levels: int
    """Number of cubes; each is twice as large as the one before, around the same middle."""
    cells: int
    """Cells along a side, a multiple of 4."""
    unbounded: bool
    """Whether the cube of the field holds all of space, contracted."""


class March(NamedTuple):
    """The positions of the samples along a ray."""

    near: float
    far: float
    finest: float
    """The distance between samples near the camera."""
    cone: float
    """The distance between samples farther away, as a share of the distance from the camera."""
    most: int
    """Largest number of samples of a ray."""
    jittered: bool
    """Whether the first sample is at a random point of its step, or in the middle."""
    seed: int
    step: Any
    """Number of the training step, (1,) int32."""


class Samples(NamedTuple):
    """Samples of rays, as kernel arrays with room for M."""

    positions: Any
    """Positions in the cube of the field from 0 to 1, (M, 3) float32."""
    distances: Any
    """Distance from the camera, and length of the step, (M, 2) float32."""
    rays: Any
    """The ray of each sample, (M,) int32."""


class Grid(NamedTuple):
    """A grid of density and colour."""

    density: Any
    """Raw densities, (N + 1, N + 1, N + 1) float32."""
    color: Any
    """Coefficients, channel by channel, (N + 1, N + 1, N + 1, C) float32, C = 16 or 32."""
    basis: int
    """Number of coefficients of a channel: 1, 4 or 9."""
    least: float
    """The raw density below which space is empty."""


class Seen(NamedTuple):
    """The composited rays of planes, or gradients by them; kernel arrays."""

    color: Any
    """(R, 3) float32."""
    opacity: Any
    """(R,) float32."""
    depth: Any
    """Weighted sum of the distances of the planes, (R,) float32."""


class Shine(NamedTuple):
    """Colours of planes that depend on the side from which a point is seen.

    The side is the offset between the point's texel and the one that the reference camera would see
    in the direction of the ray, right and down, in units of `reach`. The functions of the side
    (x, y) are x, y, x^2, x y and y^2, or the first two; a point has the sum of them times its
    coefficients, added to its colour.
    """

    maps: Any
    """Coefficients at every second texel, (G, h, w, 3 N) float32, N = 2 or 5, function by function.

    For H x W texels, h = (H - 1) // 2 + 2 and w = (W - 1) // 2 + 2.
    """
    shared: int
    """Number of planes, one behind the other, that share coefficients."""
    reach: float
    """Unit of the side, texels."""


class AdamRule(NamedTuple):
    """The constants of a step of Adam."""

    beta1: float
    beta2: float
    epsilon: float
    decay: float = 0.0
    """Weight decay: the share of each parameter that is added to its gradient."""
    sparse: bool = False
    """Whether parameters with gradient 0, and their moments, stay unchanged."""


class Learnt(NamedTuple):
    """Parameters, with their gradients and Adam's moments; kernel arrays, (N,)."""

    gradients: Any
    mean: Any
    square: Any
    weights: Any


class Comparison(NamedTuple):
    """The options of the loss between colours and photographs."""

    kind: int
    """A Background."""
    learnt: Any
    """The learnt background colour, (3,) float32."""
    huber: float
    """Error above which Huber's loss is linear; 0 for a squared loss."""
    scale: float
    """Factor of the gradients."""
    seed: int
    step: Any
    """Number of the training step, (1,) int32."""
    censored: bool = False
    """Whether a channel of 0 or 1 of an opaque pixel means that much or beyond."""


class Patches(NamedTuple):
    """How likely the patches of photographs are to show the scene; kernel arrays.

    A patch is a square of `side` pixels; the last ones of a row or column may be cut.
    """

    share: Any
    """The share of a patch that shows the scene, (N, h, w) float32."""
    sums: Any
    """Sum of the shares of its rays, in units of 1 / 256, (N, h, w) int32."""
    counts: Any
    """Number of these rays, (N, h, w) int32."""
    noise: Any
    """Mean squared error of a channel where the scene is seen, (1,) float32."""
    width: int
    """Width of a photograph, pixels."""
    side: int


class Head(NamedTuple):
    """What passes in front of photographs of one size."""

    nodes: Any
    """Density, three channels of colour, and doubt, before their functions, (N, h, w, 5) float32.
    """
    width: int
    """Width of a photograph, pixels."""
    side: int
    """Distance between nodes, pixels."""
    least: float
    """Standard deviation of the colours where nothing passes."""
    rate: float
    """Weight of the density in the loss."""
    delay: int
    """Step before which nothing passes."""


class WildGradients(NamedTuple):
    """Gradients of the loss of rays behind what passes; kernel arrays."""

    color: Any
    """(R, 3) float32."""
    opacity: Any
    """(R,) float32."""
    learnt: Any
    """By the background, (R, 3) float32."""
    head: Any
    """By the numbers of a `Head`, (R, 5) float32."""


class Lights(NamedTuple):
    """The lights of rays, numbers that a perceptron of colours is given; kernel arrays."""

    table: Any
    """The lights of photographs, (N, 16) float32."""
    views: Any
    """The photograph of each ray, (R,) int32."""


class Views(NamedTuple):
    """Rays of a view that is being rendered; kernel arrays."""

    at: Any
    """The distance at which each ray continues, (R,) float32."""
    taken: Any
    """Number of samples of each ray so far, (R,) int32."""
    color: Any
    """The result so far, as in :class:`Composited`, (R, 3) float32."""
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
    """Width of each view, pixels."""
    height: int


class Solids(NamedTuple):
    """S solids of a synthetic scene; kernel arrays."""

    kinds: Any
    """The Shape and the Pattern, (S, 2) int32."""
    placements: Any
    """The axes, each a row, and the middle, (S, 12) float32."""
    sizes: Any
    """The sizes that `Shape` lists, (S, 4) float32."""
    paints: Any
    """Two colours, gloss, parts of the pattern per length, strength of speckles, (S, 9) float32."""
