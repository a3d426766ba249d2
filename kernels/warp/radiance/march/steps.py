"""Marching of rays through an occupancy grid, in Warp.

Each ray is marched twice: first to count its samples, then, when their rows are known, to write
them. The samples of a ray are the positions t, t + spacing(t), ..., beginning at its entry, that
are in occupied cells, up to a largest number. They are the same on every device, so there is no
fused multiply-add. On the CPU a thread takes a ray, on CUDA a warp does.
"""

import warp as wp

from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.warp._launch import BLOCK, launch, launch_each
from cvkern.kernels.warp._random import random_unit
from cvkern.kernels.warp._structs import struct_of
from cvkern.kernels.warp.radiance._space import keep_sample, reach, reciprocal, row, skip, spacing
from cvkern.kernels.warp.radiance._structs import March, Rays, Samples, Space

from . import _steps_cuda as cuda
from ._steps_cuda import JITTER

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def march_kernel(
    stride: int,
    first: int,
    last: int,
    rays: Rays,  # rays after the active ones have no samples
    space: Space,
    march: March,
    writes: bool,
    # outputs
    spans: wp.array2d[int],  # (R, 2): counted unless `writes`
    samples: Samples,
):
    """Count the samples of each ray, or write them to the rows that `place` assigned."""
    for ray in range(first + wp.tid(), last, stride):
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
            inverse = reciprocal(direction)
            ends = reach(origin, inverse, space.levels, march, march.far, jitter)
            t = ends[0]
            while t < ends[1] and count < limit:
                next = skip(origin, direction, inverse, space, march, t)
                if next == t:
                    length = spacing(t, march.finest, march.cone)
                    if writes:
                        at = spans[ray, 0] + count
                        point = origin + t * direction
                        keep_sample(at, ray, point, t, length, space.unbounded, samples)
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
    """Assign to each ray the rows after those of the ray before, as long as there is room."""
    end = int(0)
    for ray in range(spans.shape[0]):
        begin = end
        end = wp.min(begin + spans[ray, 1], capacity + 1)  # the sum might not fit 32 bits
        spans[ray, 0] = begin
        if end > capacity:
            spans[ray, 0] = capacity
            spans[ray, 1] = 0
            if begin <= capacity:  # the first ray without room
                total[0] = begin
                active[0] = ray
    if end <= capacity:
        total[0] = end


def march_rays(
    space: codes.Space,
    march: codes.March,
    rays: codes.Rays,
    spans: wp.array,
    total: wp.array,
    samples: codes.Samples,
) -> None:
    """List the samples of rays in occupied cells, up to the first ray that does not fit.

    The first `active` of R rays are marched from `near` to `far` by steps of
    ``max(finest, cone t)``. `active` is lowered to the number of rays that fit, so a caller must
    set it again for the next batch. `spans` (R, 2) is filled with the first row and the number of
    rows of each ray. `total` (1,) is the number of all rows, and that many rows of `samples` are
    filled.
    """
    count = rays.origins.shape[0]
    inputs = [struct_of(Rays, rays), struct_of(Space, space), struct_of(March, march)]
    outputs = [spans, struct_of(Samples, samples)]
    room = samples.positions.shape[0]
    if spans.device.is_cuda:
        threads = cuda.THREADS * count
        launch(cuda.march, threads, [*inputs, False], outputs)
        launch(cuda.place, BLOCK, [room], [spans, total, rays.active])
        launch(cuda.march, threads, [*inputs, True], outputs)
        return
    launch_each(march_kernel, count, 256 * count, [*inputs, False], outputs)
    launch(place, 1, [room], [spans, total, rays.active])
    launch_each(march_kernel, count, 256 * count, [*inputs, True], outputs)
