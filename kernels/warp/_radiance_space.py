"""Where a point lies: in the cells of the occupancy grid, and in the cube of a field.

Lengths are in units of half the side of the innermost cube, whose middle is the origin. The grid
has levels of cubes, each of twice the side of the one before, and as many cells.
"""

import warp as wp

from ._random import random_unit


@wp.func
def level_of(point: wp.vec3, levels: int) -> int:
    """Return the innermost level whose cube has the point; `levels` where none has."""
    far = wp.max(wp.max(wp.abs(point[0]), wp.abs(point[1])), wp.abs(point[2]))
    level = int(0)
    side = float(1.0)
    while far >= side and level < levels:
        side *= 2.0
        level += 1
    return level


@wp.func
def cell_of(point: wp.vec3, level: int, cells: int) -> int:
    """Return the number of the cell of a level that the point is in."""
    middle = 0.5 * float(cells)
    scale = middle / float(1 << level)
    i = wp.clamp(int(point[0] * scale + middle), 0, cells - 1)
    j = wp.clamp(int(point[1] * scale + middle), 0, cells - 1)
    k = wp.clamp(int(point[2] * scale + middle), 0, cells - 1)
    return ((level * cells + k) * cells + j) * cells + i


@wp.func
def random_point(cell: int, cells: int, seed: int, step: int) -> wp.vec3:
    """Return a random point of a cell."""
    layer = cell // (cells * cells)
    level = layer // cells
    side = float(1 << level)
    size = 2.0 * side / float(cells)
    return wp.vec3(
        (float(cell % cells) + random_unit(seed, step, cell, 1)) * size - side,
        (float(cell // cells % cells) + random_unit(seed, step, cell, 2)) * size - side,
        (float(layer % cells) + random_unit(seed, step, cell, 3)) * size - side,
    )


@wp.func
def in_cube(point: wp.vec3, unbounded: bool) -> wp.vec3:
    """Coordinates in [0, 1] for a field; all of space contracted as in mip-NeRF 360 if wanted."""
    if not unbounded:
        return 0.5 * point + wp.vec3(0.5, 0.5, 0.5)
    length = wp.length(point)
    if length > 1.0:
        point = point * ((2.0 - 1.0 / length) / length)
    return 0.25 * point + wp.vec3(0.5, 0.5, 0.5)


@wp.func
def is_set(bits: wp.array[wp.uint32], cell: int) -> bool:
    """Tell whether the bit of a cell is set."""
    return (bits[cell >> 5] >> wp.uint32(cell & 31)) & wp.uint32(1) != wp.uint32(0)
