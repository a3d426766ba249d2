"""Where a point lies: in the cells of the occupancy grid, and in the cube of a field.

Lengths are in units of half the side of the innermost cube, whose middle is the origin. The grid
has levels of cubes, each of twice the side of the one before, and as many cells.
"""

import taichi as ti

from ._random import random_unit
from ._rounding import product

vec3 = ti.types.vector(3, ti.f32)


@ti.func
def level_of(point: vec3, levels: ti.i32) -> ti.i32:
    """Return the innermost level whose cube has the point; `levels` where none has."""
    far = ti.abs(point).max()
    level = 0
    side = 1.0
    while far >= side and level < levels:
        side *= 2.0
        level += 1
    return level


@ti.func
def cell_of(point: vec3, level: ti.i32, cells: ti.i32, zero: ti.i32) -> ti.i32:
    """Return the number of the cell of a level that the point is in."""
    middle = 0.5 * cells
    scale = middle / (1 << level)  # by a power of 2: nothing to round
    i = ti.math.clamp(ti.cast(product(point[0], scale, zero) + middle, ti.i32), 0, cells - 1)
    j = ti.math.clamp(ti.cast(product(point[1], scale, zero) + middle, ti.i32), 0, cells - 1)
    k = ti.math.clamp(ti.cast(product(point[2], scale, zero) + middle, ti.i32), 0, cells - 1)
    return ((level * cells + k) * cells + j) * cells + i


@ti.func
def random_point(cell: ti.i32, cells: ti.i32, seed: ti.i32, step: ti.i32) -> vec3:
    """Return a random point of a cell."""
    layer = cell // (cells * cells)
    level = layer // cells
    side = ti.cast(1 << level, ti.f32)
    size = 2.0 * side / cells
    corner = ti.Vector([cell % cells, cell // cells % cells, layer % cells])
    offset = ti.Vector([random_unit(seed, step, cell, k) for k in ti.static(range(1, 4))])
    return (corner + offset) * size - side


@ti.func
def in_cube(point: vec3, unbounded: ti.i32) -> vec3:
    """Coordinates in [0, 1] for a field; all of space contracted as in mip-NeRF 360 if wanted."""
    scale = 0.5
    if unbounded != 0:
        length = point.norm()
        scale = 0.25
        if length > 1.0:
            scale *= (2.0 - 1.0 / length) / length
    return scale * point + 0.5


@ti.func
def is_set(bits: ti.template(), cell: ti.i32) -> ti.i32:
    """Tell whether the bit of a cell is set."""
    return ti.cast((bits[cell >> 5] >> ti.cast(cell & 31, ti.u32)) & ti.u32(1), ti.i32)
