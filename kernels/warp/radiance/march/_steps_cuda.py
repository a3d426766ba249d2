"""Marching of rays on CUDA: one warp per ray, which tests 32 steps at once; and rows of samples.

The steps have the same bits as on the CPU, although each is the previous step plus a spacing,
rounded; see `nth_step`. No cell is skipped, because 32 steps through empty cells cost as much as a
jump.
"""

import warp as wp

from cvkern.kernels.codes.radiance import Draw
from cvkern.kernels.warp import _native
from cvkern.kernels.warp._random import random_unit
from cvkern.kernels.warp.radiance._space import (
    cell_of,
    is_set,
    keep_sample,
    level_of,
    reach,
    reciprocal,
    row,
    spacing,
)
from cvkern.kernels.warp.radiance._structs import March, Rays, Samples, Space

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

THREADS = 32  # threads of a ray
JITTER = wp.constant(int(Draw.JITTER))


@_native.func_native("_steps_cuda.cu")
def nth_step(lane: int, first: float, finest: float, cone: float) -> float: ...


@wp.func_native("return __ballot_sync(0xffffffffu, found);")
def found_by(found: bool) -> wp.uint32: ...


@wp.func_native("return __popc(lanes);")
def number_of(lanes: wp.uint32) -> int: ...


@wp.func_native("return __shfl_sync(0xffffffffu, value, 31);")
def of_last_lane(value: float) -> float: ...


@wp.kernel
def march(
    rays: Rays,  # rays after the active ones have no samples
    space: Space,
    march: March,
    writes: bool,
    # outputs
    spans: wp.array2d[int],  # (R, 2): counted unless `writes`
    samples: Samples,
):
    """Count the samples of each ray, or write them to the rows that `place` assigned."""
    ray = wp.tid() // 32
    lane = wp.tid() % 32
    begin = spans[ray, 0]
    limit = march.most
    if writes:
        limit = spans[ray, 1]
    elif ray >= rays.active[0]:
        limit = 0
    count = int(0)
    if limit > 0:
        jitter = float(0.5)
        if march.jittered:
            jitter = random_unit(march.seed, march.step[0], ray, JITTER)
        origin = row(rays.origins, ray)
        direction = row(rays.directions, ray)
        ends = reach(origin, reciprocal(direction), space.levels, march, march.far, jitter)
        first = ends[0]  # the first of 32 steps
        before = (wp.uint32(1) << wp.uint32(lane)) - wp.uint32(1)
        while first < ends[1] and count < limit:
            t = nth_step(lane, first, march.finest, march.cone)
            length = spacing(t, march.finest, march.cone)
            point = origin + t * direction
            found = bool(False)
            if t < ends[1]:
                level = level_of(point, space.levels)
                if level < space.levels:
                    found = is_set(space.bits, cell_of(point, level, space.cells))
            lanes = found_by(found)
            own = count + number_of(lanes & before)
            if writes and found and own < limit:
                at = begin + own
                keep_sample(at, ray, point, t, length, space.unbounded, samples)
            count += number_of(lanes)
            first = of_last_lane(t + length)
    if lane == 0 and not writes:
        spans[ray, 1] = wp.min(count, limit)


@_native.func_native("_steps_cuda.cu")
def place_all(
    capacity: int, spans: wp.array2d[int], total: wp.array[int], active: wp.array[int]
): ...


@wp.kernel
def place(
    capacity: int,
    # outputs
    spans: wp.array2d[int],  # (R, 2)
    total: wp.array[int],  # (1,)
    active: wp.array[int],  # (1,): lowered to the rays that have room
):
    """Assign to each ray the rows after those of the ray before, as long as there is room."""
    place_all(capacity, spans, total, active)
