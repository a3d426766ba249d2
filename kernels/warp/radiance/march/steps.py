"""Marching of rays through an occupancy grid, in Warp: where a field is looked at.

Each ray is marched twice: to count its samples, and, when it is known where they go, to write them.
The samples of a ray are all steps of the sequence t, t + spacing(t), ... from its entry on that are
in occupied cells, up to so many. They are the same on every device: hence no fused multiply-add.
"""

import warp as wp

from cvkern.kernels.warp._launch import BLOCK, launch, launch_each
from cvkern.kernels.warp._random import random_unit
from cvkern.kernels.warp.radiance._space import keep_sample, reach, reciprocal, row, skip, spacing

from . import _steps_cuda as cuda

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


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
        limit = most
        if writes:
            limit = spans[ray, 1]
        elif ray >= active[0]:
            limit = 0
        count = int(0)
        if limit > 0:
            jitter = float(0.5)
            if jittered:
                jitter = random_unit(seed, step[0], ray, 4)
            origin = row(origins, ray)
            direction = row(directions, ray)
            inverse = reciprocal(direction)
            ends = reach(origin, inverse, levels, near, far, finest, cone, jitter)
            t = ends[0]
            while t < ends[1] and count < limit:
                next = skip(origin, direction, inverse, bits, levels, cells, t, finest, cone)
                if next == t:
                    length = spacing(t, finest, cone)
                    if writes:
                        at = spans[ray, 0] + count
                        point = origin + t * direction
                        keep_sample(
                            at, ray, point, t, length, unbounded, positions, distances, rays
                        )
                    count += 1
                    next = t + length
                t = next
        if not writes:
            spans[ray, 1] = count


@wp.kernel
def place(
    capacity: int,
    # outputs
    spans: wp.array2d[int],  # (R, 2)
    total: wp.array[int],  # (1,)
    active: wp.array[int],  # (1,): lowered to the rays that have room
):
    """Give each ray the rows behind those of the ray before, as long as there are any."""
    end = int(0)
    for ray in range(spans.shape[0]):
        begin = end
        end = wp.min(begin + spans[ray, 1], capacity + 1)  # the sum might not fit 32 bits
        spans[ray, 0] = begin
        if end > capacity:
            spans[ray, 0] = capacity
            spans[ray, 1] = 0
            if begin <= capacity:  # the first without room
                total[0] = begin
                active[0] = ray
    if end <= capacity:
        total[0] = end


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
    to `far` by steps of ``max(finest, cone t)``, at most `most` samples each. `active` is lowered
    to those that fit: who wants as many again in the next batch has to write it anew. `bits` has
    one for each of the cells^3 cells (a multiple of 4 a side) of each level, in their order block
    by block.

    `spans` (R, 2) is filled with the first row and the number of rows of each ray, `total` (1,)
    with their number, and that many rows of `positions` (M, 3) in the cube of the field,
    `distances` (M, 2), the distance and the length of the step, and `rays` (M,).
    """
    count = origins.shape[0]
    inputs = [
        origins, directions, bits, levels, cells, near, far, finest, cone, most, jittered,
        unbounded, seed, step, active,
    ]  # fmt: skip
    outputs = [spans, positions, distances, rays]
    if spans.device.is_cuda:
        threads = cuda.THREADS * count
        launch(cuda.march, threads, [*inputs, False], outputs)
        launch(cuda.place, BLOCK, [positions.shape[0]], [spans, total, active])
        launch(cuda.march, threads, [*inputs, True], outputs)
        return
    launch_each(march_kernel, count, 256 * count, [*inputs, False], outputs)
    launch(place, 1, [positions.shape[0]], [spans, total, active])
    launch_each(march_kernel, count, 256 * count, [*inputs, True], outputs)
