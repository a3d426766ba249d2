"""A round of views on CUDA: a thread finds a ray's next samples, a warp writes those of 32 rays."""

import warp as wp

from cvkern.kernels.warp import _native

from ._next_samples import look
from ._space import keep_sample, row, spacing
from ._structs import March, Rays, Samples, Space, Views

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@_native.func_native("_rendering_cuda.cu")
def append(
    ray: int, number: int, going: wp.array[int], spans: wp.array2d[int], counts: wp.array[int]
) -> int:
    """Return the row of a ray's first sample; all threads of a block must call this together."""
    ...


@_native.func_native("_rendering_cuda.cu")
def owner(at: int, first: int) -> int:
    """Return the lane whose rows, beginning at its `first`, contain row `at`; for a whole warp."""
    ...


@wp.func_native("return __shfl_sync(0xffffffffu, value, lane);")
def of_lane(value: int, lane: int) -> int: ...


@wp.kernel
def march_on(
    rays: Rays,
    space: Space,
    march: March,
    few: int,
    living: int,
    listing: wp.array[int],  # (R,)
    # outputs
    views: Views,
    times: wp.array[float],  # (M,)
    going: wp.array[int],  # (R,)
    spans: wp.array2d[int],  # (R, 2)
    counts: wp.array[int],  # (2,): added to
    samples: Samples,
):
    """Find the next samples of rays, list the rays that have samples, and write the samples."""
    i = wp.tid()
    ray = int(0)
    number = int(0)
    if i < living:
        ray = listing[i]
        number = look(rays, space, march, few, living, i, ray, views, times)
    first = append(ray, number, going, spans, counts)
    # The rows of a warp are adjacent, so its lanes write 32 rows at a time, of any of its rays.
    lane = i % 32
    begin = of_lane(first, 0)
    end = of_lane(first + number, 31)
    while begin < end:
        sample = begin + lane
        source = owner(sample, first)
        its_ray = of_lane(ray, source)
        its_first = of_lane(first, source)
        if sample < end:
            t = times[(sample - its_first) * living + i - lane + source]
            point = row(rays.origins, its_ray) + t * row(rays.directions, its_ray)
            step = spacing(t, march.finest, march.cone)
            keep_sample(sample, its_ray, point, t, step, space.unbounded, samples)
        begin += 32
