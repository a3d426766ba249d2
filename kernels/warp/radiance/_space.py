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

import warp as wp

from cvkern.kernels.codes.radiance import Draw
from cvkern.kernels.warp._random import random_unit

from ._structs import March, Samples, Space

CELL_X, CELL_Y, CELL_Z = (wp.constant(int(d)) for d in (Draw.CELL_X, Draw.CELL_Y, Draw.CELL_Z))


@wp.func
def within(point: wp.vec3, side: float) -> bool:
    """Tell whether the cube from -side to side contains the point."""
    inside = point[0] >= -side and point[0] < side
    inside = inside and point[1] >= -side and point[1] < side
    return inside and point[2] >= -side and point[2] < side


@wp.func
def level_of(point: wp.vec3, levels: int) -> int:
    """Return the innermost level whose cube contains the point; `levels` if there is none."""
    level = int(0)
    side = float(1.0)
    while level < levels and not within(point, side):
        side *= 2.0
        level += 1
    return level


@wp.func
def half(times: int) -> float:
    """Return 2^-times, for times up to 16; a division would take longer."""
    return float(1 << (16 - times)) / 65536.0


@wp.func
def cell_of(point: wp.vec3, level: int, cells: int) -> int:
    """Return the number of the cell of a level that contains the point, which is in its cube."""
    middle = cells // 2
    scale = float(middle) * half(level)
    i = int(wp.floor(point[0] * scale)) + middle
    j = int(wp.floor(point[1] * scale)) + middle
    k = int(wp.floor(point[2] * scale)) + middle
    blocks = cells >> 2
    block = ((level * blocks + (k >> 2)) * blocks + (j >> 2)) * blocks + (i >> 2)
    return block << 6 | (k & 3) << 4 | (j & 3) << 2 | i & 3


@wp.func
def random_point(cell: int, cells: int, seed: int, step: int) -> wp.vec3:
    """Return a random point of a cell."""
    blocks = cells >> 2
    block = cell >> 6
    layer = block // (blocks * blocks)
    level = layer // blocks
    i = block % blocks << 2 | cell & 3
    j = block // blocks % blocks << 2 | cell >> 2 & 3
    k = layer % blocks << 2 | cell >> 4 & 3
    side = float(1 << level)
    size = 2.0 * side / float(cells)
    return wp.vec3(
        (float(i) + random_unit(seed, step, cell, CELL_X)) * size - side,
        (float(j) + random_unit(seed, step, cell, CELL_Y)) * size - side,
        (float(k) + random_unit(seed, step, cell, CELL_Z)) * size - side,
    )


@wp.func
def in_cube(point: wp.vec3, unbounded: bool) -> wp.vec3:
    """Return coordinates in [0, 1] of a field; unbounded space is contracted (mip-NeRF 360)."""
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


@wp.func
def is_block_empty(bits: wp.array[wp.uint32], cell: int) -> bool:
    """Tell whether no bit of the block of a cell is set."""
    return bits[cell >> 5] | bits[cell >> 5 ^ 1] == wp.uint32(0)


@wp.func
def row(a: wp.array2d[float], i: int) -> wp.vec3:
    """Return row `i` as a vector."""
    return wp.vec3(a[i, 0], a[i, 1], a[i, 2])


@wp.func
def spacing(t: float, finest: float, cone: float) -> float:
    """Return the distance between samples, which grows with the distance from the camera."""
    return wp.max(finest, cone * t)


@wp.func
def interval(origin: wp.vec3, inverse: wp.vec3, side: float) -> wp.vec2:
    """Return the distances at which a ray enters and leaves the cube from -side to side."""
    enter = float(-1.0e30)
    leave = float(1.0e30)
    for k in range(3):
        a = (-side - origin[k]) * inverse[k]
        b = (side - origin[k]) * inverse[k]
        enter = wp.max(enter, wp.min(a, b))
        leave = wp.min(leave, wp.max(a, b))
    return wp.vec2(enter, leave)


@wp.func
def reciprocal(direction: wp.vec3) -> wp.vec3:
    """Return 1 over each component, finite if it is 0."""
    inverse = wp.vec3()
    for k in range(3):
        d = direction[k]
        if wp.abs(d) < 1.0e-12:
            d = wp.where(d < 0.0, -1.0e-12, 1.0e-12)
        inverse[k] = 1.0 / d
    return inverse


@wp.func
def way_out(point: wp.vec3, inverse: wp.vec3, level: int, cells: int) -> float:
    """Return the distance along the ray to the point where it leaves the cell of `point`."""
    scale = float(cells // 2) * half(level)
    size = 1.0 / float(cells // 2) * float(1 << level)
    way = float(1.0e30)
    for k in range(3):
        at = point[k] * scale
        side = wp.floor(at) + wp.where(inverse[k] > 0.0, 1.0, 0.0)
        way = wp.min(way, wp.max((side - at) * size * inverse[k], 0.0))
    return way


@wp.func
def reach(
    origin: wp.vec3,
    inverse: wp.vec3,
    levels: int,
    march: March,
    far: float,
    jitter: float,
) -> wp.vec2:
    """Return the distance of the first position, a share of a step after entry, and of the end."""
    inside = interval(origin, inverse, float(1 << (levels - 1)))
    entry = wp.max(march.near, inside[0])
    first = entry + jitter * spacing(entry, march.finest, march.cone)
    return wp.vec2(first, wp.min(far, inside[1]))


@wp.func
def skip(
    origin: wp.vec3,
    direction: wp.vec3,
    inverse: wp.vec3,
    space: Space,
    march: March,
    t: float,
) -> float:
    """Return the next distance to test; no sample of the ray lies before it.

    Samples are the positions t, t + spacing(t), ... that are in occupied cells. If there is a
    sample at t, return t.
    """
    point = origin + t * direction
    level = level_of(point, space.levels)
    next = t + spacing(t, march.finest, march.cone)
    if level == space.levels:  # on an outermost side
        return next
    cell = cell_of(point, level, space.cells)
    if is_set(space.bits, cell):
        return t
    shift = int(0)  # log2 of the side of the empty region, in cells
    if space.cells % 16 == 0 and is_block_empty(space.bits, cell):
        shift = 2
    goal = t + way_out(point, inverse, level + shift, space.cells)
    inside = t
    behind = next
    while behind < goal:
        inside = behind
        behind += spacing(behind, march.finest, march.cone)
    # The goal is rounded. The skipped positions are empty if the last one is inside.
    own = cell_of(origin + inside * direction, level, space.cells)
    return wp.where(own >> 3 * shift == cell >> 3 * shift, behind, next)


@wp.func
def keep_sample(
    at: int,
    ray: int,
    point: wp.vec3,
    t: float,
    step: float,
    unbounded: bool,
    samples: Samples,
):
    """Write a sample of a ray to row `at`."""
    position = in_cube(point, unbounded)
    for k in range(3):
        samples.positions[at, k] = position[k]
    samples.distances[at, 0] = t
    samples.distances[at, 1] = step
    samples.rays[at] = ray
