"""Splats in kernels, as Warp structures with the fields of kernels/codes/splats.py."""

import warp as wp


@wp.struct
class Splats:
    """Splats, or gradients by them."""

    means: wp.array2d[float]  # (N, 3)
    turns: wp.array2d[float]  # (N, 4)
    scales: wp.array2d[float]  # (N, 3)
    opacities: wp.array2d[float]  # (N, 1)
    colors: wp.array2d[float]  # (N, 3)
    sides: wp.array2d[float]  # (N, 3 (K - 1)), or (1, 1)


@wp.struct
class Sight:
    """A view of some cameras."""

    poses: wp.array3d[float]  # (V, 3, 4)
    lenses: wp.array2d[float]  # (V, 9)
    view: wp.array[int]  # (1,)
    width: int
    height: int
    near: float
    blur: float


@wp.struct
class Screen:
    """Splats on the screen."""

    shown: wp.array2d[float]  # (N, 12)
    boxes: wp.array2d[int]  # (N, 4)
    keys: wp.array[int]  # (N,)


@wp.struct
class Lists:
    """The splats of tiles."""

    order: wp.array[int]  # (N,)
    ranks: wp.array[int]  # (N,)
    ends: wp.array[int]  # (N,)
    entries: wp.array[int]  # (E,)
    sources: wp.array[int]  # (E,)
    ranges: wp.array[int]  # (T + 1,)


@wp.struct
class Tiles:
    """A picture in tiles, and the splats of each tile."""

    shown: wp.array2d[float]  # (N, 12)
    entries: wp.array[int]  # (E,)
    sources: wp.array[int]  # (E,)
    ranges: wp.array[int]  # (T + 1,)
    width: int
    height: int
    stop: float
