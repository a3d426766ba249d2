"""Marching of rays through an occupancy grid, in Taichi; one thread per ray.

Each ray is marched twice: first to count its samples, then, when their rows are known, to write
them. The samples of a ray are the positions t, t + spacing(t), ..., beginning at its entry, that
are in occupied cells, up to a largest number. They are the same on every device, so products are
rounded before sums (`zero`, see _rounding.py).
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.codes.radiance import Draw
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._random import random_unit
from cvkern.kernels.taichi.radiance._space import (
    in_cube,
    keep_sample,
    place,
    reach,
    reciprocal,
    row,
    skip,
    spacing,
)
from cvkern.kernels.taichi.radiance._structs import March, march_of

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
u32_1 = ti.types.ndarray(dtype=ti.u32, ndim=1)


@ti.kernel
def _march(
    origins: f32_2,  # (R, 3)
    directions: f32_2,  # (R, 3)
    bits: u32_1,  # (levels cells^3 / 32,)
    march: March,
    step: i32_1,  # (1,)
    active: i32_1,  # (1,): rays behind so many have no samples
    writes: ti.i32,
    zero: ti.i32,
    # outputs
    spans: i32_2,  # (R, 2): counted unless `writes`
    positions: f32_2,  # (M, 3)
    distances: f32_2,  # (M, 2): distance, and length of the step
    rays: i32_1,  # (M,)
):
    for ray in range(origins.shape[0]):
        limit = march.most
        if writes != 0:
            limit = spans[ray, 1]
        elif ray >= active[0]:
            limit = 0
        count = 0
        if limit > 0:
            jitter = 0.5
            if march.jittered != 0:
                jitter = random_unit(march.seed, step[0], ray, Draw.JITTER)
            origin = row(origins, ray)
            direction = row(directions, ray)
            inverse = reciprocal(direction, zero)
            ends = reach(origin, inverse, march, jitter, zero)
            t = ends[0]
            while t < ends[1] and count < limit:
                next = skip(origin, direction, inverse, bits, march, t, zero)
                if next == t:
                    length = spacing(t, march, zero)
                    if writes != 0:
                        at = spans[ray, 0] + count
                        point = place(origin, t, direction, zero)
                        cube = in_cube(point, march.unbounded)
                        keep_sample(at, ray, cube, t, length, positions, distances, rays)
                    count += 1
                    next = t + length
                t = next
        if writes == 0:
            spans[ray, 1] = count


@ti.kernel
def _place(
    capacity: ti.i32,
    # outputs
    spans: i32_2,  # (R, 2)
    total: i32_1,  # (1,)
    active: i32_1,  # (1,): lowered to the rays that have room
):
    for _ in range(1):
        end = 0
        for ray in range(spans.shape[0]):
            begin = end
            end = ti.min(begin + spans[ray, 1], capacity + 1)  # the sum might not fit 32 bits
            spans[ray, 0] = begin
            if end > capacity:
                spans[ray, 0] = capacity
                spans[ray, 1] = 0
                if begin <= capacity:  # the first ray without room
                    total[0] = begin
                    active[0] = ray
        if end <= capacity:
            total[0] = end


@primitive
def march_rays(
    space: codes.Space,
    march: codes.March,
    rays: codes.Rays,
    spans: np.ndarray,
    total: np.ndarray,
    samples: codes.Samples,
) -> None:
    """List the samples of rays in occupied cells, up to the first ray that does not fit.

    The first `active` of R rays are marched from `near` to `far` by steps of
    ``max(finest, cone t)``. `active` is lowered to the number of rays that fit, so a caller must
    set it again for the next batch. `spans` (R, 2) is filled with the first row and the number of
    rows of each ray. `total` (1,) is the number of all rows, and that many rows of `samples` are
    filled.
    """
    numbers = march_of(space, march)
    given = rays.origins, rays.directions, space.bits, numbers, march.step, rays.active
    _march(*given, False, 0, spans, *samples)
    _place(samples.positions.shape[0], spans, total, rays.active)
    _march(*given, True, 0, spans, *samples)
