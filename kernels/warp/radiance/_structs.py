"""Arguments that travel together through kernels, as Warp structures.

Each has the fields of the tuple of the same name in kernels/codes/radiance.py, in the same order.
"""

import warp as wp


@wp.struct
class Rays:
    """A batch of rays."""

    origins: wp.array2d[float]  # (R, 3)
    directions: wp.array2d[float]  # (R, 3)
    active: wp.array[int]  # (1,)


@wp.struct
class Composited:
    """The composited rays, without a background, or gradients by them."""

    color: wp.array2d[float]  # (R, 3)
    opacity: wp.array[float]  # (R,)
    depth: wp.array[float]  # (R,)
    distortion: wp.array[float]  # (R,)


@wp.struct
class Space:
    """The cells of space that are not empty."""

    bits: wp.array[wp.uint32]  # (levels cells^3 / 32,)
    levels: int
    cells: int
    unbounded: bool


@wp.struct
class March:
    """The positions of the samples along a ray."""

    near: float
    far: float
    finest: float
    cone: float
    most: int
    jittered: bool
    seed: int
    step: wp.array[int]  # (1,)


@wp.struct
class Grid:
    """A grid of density and colour."""

    density: wp.array3d[float]  # (N + 1, N + 1, N + 1)
    color: wp.array4d[float]  # (N + 1, N + 1, N + 1, C)
    basis: int
    least: float


@wp.struct
class Seen:
    """The composited rays of planes, or gradients by them."""

    color: wp.array2d[float]  # (R, 3)
    opacity: wp.array[float]  # (R,)
    depth: wp.array[float]  # (R,)


@wp.struct
class Samples:
    """Samples of rays."""

    positions: wp.array2d[float]  # (M, 3)
    distances: wp.array2d[float]  # (M, 2): distance, and length of the step
    rays: wp.array[int]  # (M,)


@wp.struct
class Views:
    """Rays of a view that is being rendered."""

    at: wp.array[float]  # (R,)
    taken: wp.array[int]  # (R,)
    color: wp.array2d[float]  # (R, 3)
    opacity: wp.array[float]  # (R,)
    depth: wp.array[float]  # (R,)


@wp.struct
class CameraSet:
    """Cameras of one size."""

    poses: wp.array3d[float]  # (N, 3, 4)
    lenses: wp.array2d[float]  # (N, 9): fx fy cx cy k1 k2 p1 p2 k3
    width: int
    height: int


@wp.struct
class Solids:
    """Solids of a synthetic scene."""

    kinds: wp.array2d[int]  # (S, 2): Shape, Pattern
    placements: wp.array2d[float]  # (S, 12): the axes, each a row, and the middle
    sizes: wp.array2d[float]  # (S, 4): see Shape
    paints: wp.array2d[float]  # (S, 8): two colours, gloss, parts of the pattern per length


@wp.struct
class Comparison:
    """The options of the loss between colours and photographs."""

    kind: int
    learnt: wp.array[float]  # (3,)
    huber: float
    scale: float
    seed: int
    step: wp.array[int]  # (1,)
    censored: bool


@wp.struct
class Patches:
    """How likely the patches of photographs are to show the scene."""

    share: wp.array3d[float]  # (N, h, w)
    sums: wp.array3d[int]  # (N, h, w)
    counts: wp.array3d[int]  # (N, h, w)
    noise: wp.array[float]  # (1,)
    width: int
    side: int


@wp.struct
class Head:
    """What passes in front of photographs of one size."""

    nodes: wp.array4d[float]  # (N, h, w, 5)
    width: int
    side: int
    least: float
    rate: float
    delay: int


@wp.struct
class WildGradients:
    """Gradients of the loss of rays behind what passes."""

    color: wp.array2d[float]  # (R, 3)
    opacity: wp.array[float]  # (R,)
    learnt: wp.array2d[float]  # (R, 3)
    head: wp.array2d[float]  # (R, 5)


@wp.struct
class Sides:
    """The sides from which samples are seen, and their lights."""

    directions: wp.array2d[float]  # (R, 3)
    rays: wp.array[int]  # (M,)
    table: wp.array2d[float]  # (N, 16)
    views: wp.array[int]  # (R,)


# Names in native code of the structures that its own structures contain.
NATIVE = {kind.__name__: kind.native_name for kind in (Rays, Space, March, Grid)}
