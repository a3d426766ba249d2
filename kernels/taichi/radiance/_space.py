"""Positions on a ray: the cells of the occupancy grid, and the cube of a field.

Lengths are in units of half the side of the innermost cube, and the middle of the cube is the
origin. The grid has levels of cubes: each cube has twice the side of the one before, and the same
number of cells, a multiple of 4 along a side. A point belongs to the innermost cube that contains
it; cubes and cells include their lower sides. Cells are numbered in blocks of 4 x 4 x 4, and the
bits of a block are two words.

Rounding keeps the order of numbers. So along a ray, each coordinate of the positions, and of their
cells, is monotonic. The sides of cubes are represented exactly, so cells of different levels share
no point. Therefore all positions between two positions in one cell are in this cell too, exactly.
The same holds for blocks if blocks of different levels share no point: if the cells along a side
are a multiple of 16.
"""

import taichi as ti

from cvkern.kernels.codes.radiance import Draw
from cvkern.kernels.taichi._random import random_unit
from cvkern.kernels.taichi._rounding import product, quotient
from cvkern.kernels.taichi.radiance._structs import March

vec2 = ti.types.vector(2, ti.f32)
vec3 = ti.types.vector(3, ti.f32)


CELL = [int(draw) for draw in (Draw.CELL_X, Draw.CELL_Y, Draw.CELL_Z)]


@ti.func
def within(point: vec3, side: ti.f32) -> ti.i32:
    """Tell whether the cube from -side to side contains the point."""
    return (point >= -side).all() and (point < side).all()


@ti.func
def level_of(point: vec3, levels: ti.i32) -> ti.i32:
    """Return the innermost level whose cube contains the point; `levels` if there is none."""
    level = 0
    side = 1.0
    while level < levels and not within(point, side):
        side *= 2.0
        level += 1
    return level


@ti.func
def cell_of(point: vec3, level: ti.i32, cells: ti.i32) -> ti.i32:
    """Return the number of the cell of a level that contains the point, which is in its cube."""
    middle = cells // 2
    scale = ti.cast(middle, ti.f32) / (1 << level)  # exact, because the factor is a power of 2
    at = ti.floor(point * scale, ti.i32) + middle
    block, blocks = at >> 2, cells >> 2
    number = ((level * blocks + block[2]) * blocks + block[1]) * blocks + block[0]
    return number << 6 | (at[2] & 3) << 4 | (at[1] & 3) << 2 | at[0] & 3


@ti.func
def place(origin: vec3, t: ti.f32, direction: vec3, zero: ti.i32) -> vec3:
    """Return the position at a distance on a ray."""
    point = vec3(0.0)
    for k in ti.static(range(3)):
        point[k] = origin[k] + product(t, direction[k], zero)
    return point


@ti.func
def random_point(cell: ti.i32, cells: ti.i32, seed: ti.i32, step: ti.i32) -> vec3:
    """Return a random point of a cell."""
    blocks, block = cells >> 2, cell >> 6
    layer = block // (blocks * blocks)
    level = layer // blocks
    side = ti.cast(1 << level, ti.f32)
    size = 2.0 * side / cells
    corner = 4 * ti.Vector([block % blocks, block // blocks % blocks, layer % blocks])
    corner += ti.Vector([cell, cell >> 2, cell >> 4]) & 3
    offset = ti.Vector([random_unit(seed, step, cell, k) for k in ti.static(CELL)])
    return (corner + offset) * size - side


@ti.func
def in_cube(point: vec3, unbounded: ti.i32) -> vec3:
    """Return coordinates in [0, 1] of a field; unbounded space is contracted (mip-NeRF 360)."""
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


@ti.func
def is_block_empty(bits: ti.template(), cell: ti.i32) -> ti.i32:
    """Tell whether no bit of the block of a cell is set."""
    return (bits[cell >> 5] | bits[cell >> 5 ^ 1]) == 0


@ti.func
def row(a: ti.template(), i: ti.i32) -> vec3:
    """Return row `i` as a vector."""
    return vec3(a[i, 0], a[i, 1], a[i, 2])


@ti.func
def spacing(t: ti.f32, march: March, zero: ti.i32) -> ti.f32:
    """Return the distance between samples, which grows with the distance from the camera."""
    return ti.max(march.finest, product(march.cone, t, zero))


@ti.func
def interval(origin: vec3, inverse: vec3, side: ti.f32, zero: ti.i32) -> vec2:
    """Return the distances at which a ray enters and leaves the cube from -side to side."""
    enter = -1.0e30
    leave = 1.0e30
    for k in ti.static(range(3)):
        a = product(-side - origin[k], inverse[k], zero)
        b = product(side - origin[k], inverse[k], zero)
        enter = ti.max(enter, ti.min(a, b))
        leave = ti.min(leave, ti.max(a, b))
    return vec2(enter, leave)


@ti.func
def reciprocal(direction: vec3, zero: ti.i32) -> vec3:
    """Return 1 over each component, finite if it is 0."""
    inverse = vec3(0.0)
    for k in ti.static(range(3)):
        d = direction[k]
        if ti.abs(d) < 1.0e-12:
            d = -1.0e-12 if d < 0.0 else 1.0e-12
        inverse[k] = quotient(1.0, d, zero)
    return inverse


@ti.func
def way_out(point: vec3, inverse: vec3, level: ti.i32, cells: ti.i32, zero: ti.i32) -> ti.f32:
    """Return the distance along the ray to the point where it leaves the cell of `point`."""
    size = quotient(2.0 * (1 << level), ti.cast(cells, ti.f32), zero)
    way = 1.0e30
    for k in ti.static(range(3)):
        at = quotient(point[k], size, zero)
        side = ti.floor(at) + (1.0 if inverse[k] > 0.0 else 0.0)
        way = ti.min(way, ti.max(product(product(side - at, size, zero), inverse[k], zero), 0.0))
    return way


@ti.func
def reach(origin: vec3, inverse: vec3, march: March, jitter: ti.f32, zero: ti.i32) -> vec2:
    """Return the distance of the first position, a share of a step after entry, and of the end."""
    inside = interval(origin, inverse, ti.cast(1 << (march.levels - 1), ti.f32), zero)
    entry = ti.max(march.near, inside[0])
    first = entry + product(jitter, spacing(entry, march, zero), zero)
    return vec2(first, ti.min(march.far, inside[1]))


@ti.func
def skip(
    origin: vec3,
    direction: vec3,
    inverse: vec3,
    bits: ti.template(),
    march: March,
    t: ti.f32,
    zero: ti.i32,
) -> ti.f32:
    """Return the next distance to test; no sample of the ray lies before it.

    Samples are the positions t, t + spacing(t), ... that are in occupied cells. If there is a
    sample at t, return t.
    """
    point = place(origin, t, direction, zero)
    level = level_of(point, march.levels)
    found = t + spacing(t, march, zero)  # if `point` is on an outermost side
    if level < march.levels:
        cell = cell_of(point, level, march.cells)
        if is_set(bits, cell) != 0:
            found = t
        else:
            shift = 0  # log2 of the side of the empty region, in cells
            if march.cells % 16 == 0 and is_block_empty(bits, cell):
                shift = 2
            goal = t + way_out(point, inverse, level, march.cells >> shift, zero)
            inside = t
            behind = found
            while behind < goal:
                inside = behind
                behind += spacing(behind, march, zero)
            # The goal is rounded. The skipped positions are empty if the last one is inside.
            own = cell_of(place(origin, inside, direction, zero), level, march.cells)
            if own >> 3 * shift == cell >> 3 * shift:
                found = behind
    return found


@ti.func
def keep_sample(
    at: ti.i32,
    ray: ti.i32,
    position: vec3,
    t: ti.f32,
    step: ti.f32,
    positions: ti.template(),
    distances: ti.template(),
    rays: ti.template(),
):
    """Write a sample of a ray to row `at`."""
    for k in ti.static(range(3)):
        positions[at, k] = position[k]
    distances[at, 0] = t
    distances[at, 1] = step
    rays[at] = ray
