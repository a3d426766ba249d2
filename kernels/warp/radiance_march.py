"""Marching of rays through an occupancy grid, in Warp: where a field is looked at.

One thread a ray, twice: to count its samples, and, when it is known where they go, to write them.
Which cells are met is the same on every device: hence no fused multiply-add.
"""

import warp as wp

from . import _radiance_march_blocks as blocks
from ._launch import launch, launch_each
from ._radiance_space import cell_of, in_cube, is_set, level_of
from ._random import random_unit

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def row(a: wp.array2d[float], i: int) -> wp.vec3:
    """Return row `i` as a vector."""
    return wp.vec3(a[i, 0], a[i, 1], a[i, 2])


@wp.func
def spacing(t: float, finest: float, cone: float) -> float:
    """Distance between samples: it grows with the distance from the camera."""
    return wp.max(finest, cone * t)


@wp.func
def interval(origin: wp.vec3, inverse: wp.vec3, side: float) -> wp.vec2:
    """Distances at which a ray enters and leaves the cube from -side to side."""
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
    """One over each part, finite where that is 0."""
    inverse = wp.vec3()
    for k in range(3):
        d = direction[k]
        if wp.abs(d) < 1.0e-12:
            d = wp.where(d < 0.0, -1.0e-12, 1.0e-12)
        inverse[k] = 1.0 / d
    return inverse


@wp.func
def way_out(point: wp.vec3, inverse: wp.vec3, level: int, cells: int) -> float:
    """Distance along the ray to where it leaves the cell of a point."""
    size = 2.0 * float(1 << level) / float(cells)
    way = float(1.0e30)
    for k in range(3):
        at = point[k] / size
        side = wp.floor(at) + wp.where(inverse[k] > 0.0, 1.0, 0.0)
        way = wp.min(way, wp.max((side - at) * size * inverse[k], 0.0))
    return way


@wp.func
def march(
    ray: int,
    origins: wp.array2d[float],
    directions: wp.array2d[float],
    bits: wp.array[wp.uint32],
    levels: int,
    cells: int,
    near: float,
    far: float,
    finest: float,
    cone: float,
    most: int,
    jitter: float,
    unbounded: bool,
    begin: int,
    positions: wp.array2d[float],
    distances: wp.array2d[float],
    rays: wp.array[int],
) -> int:
    """Count the samples of a ray, and write them from `begin` on unless that is negative."""
    origin = row(origins, ray)
    direction = row(directions, ray)
    inverse = reciprocal(direction)
    inside = interval(origin, inverse, float(1 << (levels - 1)))
    t = wp.max(near, inside[0])
    last = wp.min(far, inside[1])
    t += jitter * spacing(t, finest, cone)
    count = int(0)
    while t < last and count < most:
        point = origin + t * direction
        level = level_of(point, levels)
        step = spacing(t, finest, cone)
        if level == levels:  # on the outermost side
            t += step
        elif is_set(bits, cell_of(point, level, cells)):
            if begin >= 0:
                at = in_cube(point, unbounded)
                for k in range(3):
                    positions[begin + count, k] = at[k]
                distances[begin + count, 0] = t
                distances[begin + count, 1] = step
                rays[begin + count] = ray
            count += 1
            t += step
        else:  # by whole steps behind the cell, so that samples stay where they would have been
            goal = t + way_out(point, inverse, level, cells)
            t += step
            while t < goal:
                t += spacing(t, finest, cone)
    return count


@wp.kernel
def march_kernel(
    stride: int,
    first: int,
    last: int,
    origins: wp.array2d[float],  # (R, 3)
    directions: wp.array2d[float],  # (R, 3)
    bits: wp.array[wp.uint32],  # (levels cells^3 / 32,)
    levels: int,
    cells: int,
    near: float,
    far: float,
    finest: float,
    cone: float,
    most: int,
    jittered: bool,
    unbounded: bool,
    seed: int,
    step: wp.array[int],  # (1,)
    active: wp.array[int],  # (1,): rays behind so many have no samples
    writes: bool,
    # outputs
    spans: wp.array2d[int],  # (R, 2): counted unless `writes`
    positions: wp.array2d[float],  # (M, 3)
    distances: wp.array2d[float],  # (M, 2): distance, and length of the step
    rays: wp.array[int],  # (M,)
):
    """Count the samples of each ray, or write them where `place` said."""
    for ray in range(first + wp.tid(), last, stride):
        begin = int(-1)
        limit = most
        if writes:
            begin = spans[ray, 0]
            limit = spans[ray, 1]
        elif ray >= active[0]:
            spans[ray, 1] = 0
            limit = 0
        if limit > 0:
            jitter = float(0.5)
            if jittered:
                jitter = random_unit(seed, step[0], ray, 4)
            count = march(
                ray, origins, directions, bits, levels, cells, near, far, finest, cone, limit,
                jitter, unbounded, begin, positions, distances, rays,
            )  # fmt: skip
            if not writes:
                spans[ray, 1] = count


@wp.kernel
def place(
    capacity: int,
    # outputs
    spans: wp.array2d[int],  # (R, 2)
    total: wp.array[int],  # (1,)
):
    """Give each ray the rows behind those of the ray before, as long as there are any."""
    end = int(0)
    kept = int(0)
    for ray in range(spans.shape[0]):
        spans[ray, 0] = end
        end += spans[ray, 1]
        if end > capacity:
            spans[ray, 1] = 0
        else:
            kept = end
    total[0] = kept


def march_rays(
    origins: wp.array,
    directions: wp.array,
    bits: wp.array,
    levels: int,
    cells: int,
    near: float,
    far: float,
    finest: float,
    cone: float,
    most: int,
    jittered: bool,
    unbounded: bool,
    seed: int,
    step: wp.array,
    active: wp.array,
    spans: wp.array,
    total: wp.array,
    positions: wp.array,
    distances: wp.array,
    rays: wp.array,
) -> None:
    """List the samples of rays in occupied cells; from the first ray that does not fit on, none.

    Of `origins` and unit `directions` (R, 3), the first `active` (1,) rays are marched from `near`
    to `far` by steps of ``max(finest, cone t)``, at most `most` samples each. `bits` has one for
    each of the cells^3 cells (a multiple of 4 a side) of each level. `spans` (R, 2) is filled with
    the first row and the number of rows of each ray, `total` (1,) with their number, and that many
    rows of `positions` (M, 3) in the cube of the field, `distances` (M, 2), the distance and the
    length of the step, and `rays` (M,).
    """
    count = origins.shape[0]
    march = [
        origins, directions, bits, levels, cells, near, far, finest, cone, most, jittered,
        unbounded, seed, step, active,
    ]  # fmt: skip
    outputs = [spans, positions, distances, rays]
    launch_each(march_kernel, count, 256 * count, [*march, False], outputs)
    scan, threads = (blocks.place, 256) if spans.device.is_cuda else (place, 1)
    launch(scan, threads, [positions.shape[0]], [spans, total])
    launch_each(march_kernel, count, 256 * count, [*march, True], outputs)
