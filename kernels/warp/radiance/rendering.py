"""Views of a field of samples, in Warp, in rounds that process the next few samples of each ray.

A ray has the distance at which it continues, its number of samples so far, and its result so far. A
list holds the numbers of the active rays. Each round makes a new list without the rays that left
the field, or whose light is down to the share `stop`. The samples of a ray are those of
march/steps.py; they do not depend on the number per round. One thread per ray; on CUDA, a warp
writes the samples of its 32 rays.
"""

from typing import Any

import warp as wp

from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.warp._launch import BLOCK, launch, launch_each, launch_slabs, scratch, slabs
from cvkern.kernels.warp._structs import struct_of

from . import _rendering_cuda as cuda
from ._next_samples import look
from ._space import keep_sample, reach, reciprocal, row, spacing
from ._structs import March, Rays, Samples, Space, Views

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

NEVER = wp.constant(1.0e30)  # the distance of a ray that is finished


@wp.kernel
def set_out_kernel(
    stride: int,
    first: int,
    last: int,
    rays: Rays,
    space: Space,
    march: March,
    # outputs
    listing: wp.array[int],  # (R,)
    counts: wp.array[int],  # (2,)
    views: Views,
):
    """Move a ray to the point where it enters the field."""
    for ray in range(first + wp.tid(), last, stride):
        if ray == 0:
            counts[0] = 0
            counts[1] = 0
        inverse = reciprocal(row(rays.directions, ray))
        ends = reach(row(rays.origins, ray), inverse, space.levels, march, NEVER, 0.5)
        views.at[ray] = ends[0]
        views.taken[ray] = 0
        listing[ray] = ray
        for k in range(3):
            views.color[ray, k] = 0.0
        views.opacity[ray] = 0.0
        views.depth[ray] = 0.0


def set_out(
    rays: codes.Rays,
    space: codes.Space,
    march: codes.March,
    listing: wp.array,
    counts: wp.array,
    views: codes.Views,
) -> None:
    """Begin the views of all R rays; `active` is ignored.

    A ray begins where `march.steps.march_rays` begins without jitter. `listing` (R,) holds all
    rays; the rest of `views`, and `counts` (2,), are set to 0.
    """
    count = rays.origins.shape[0]
    inputs = _march(rays, space, march)
    outputs = [listing, counts, struct_of(Views, views)]
    launch_each(set_out_kernel, count, 32 * count, inputs, outputs)


def _march(rays: codes.Rays, space: codes.Space, march: codes.March) -> list[Any]:
    return [struct_of(Rays, rays), struct_of(Space, space), struct_of(March, march)]


@wp.kernel
def look_on(
    slab: int,
    first: int,
    last: int,
    rays: Rays,
    space: Space,
    march: March,
    few: int,
    living: int,
    listing: wp.array[int],  # (R,)
    # outputs
    views: Views,
    times: wp.array[float],  # (M,)
    numbers: wp.array[int],  # (R,): of samples, in the order of the list
):
    """Find the next samples of a ray, and move the ray behind the last of them."""
    for i in range(first, last):
        numbers[i] = look(rays, space, march, few, living, i, listing[i], views, times)


@wp.kernel
def place(
    living: int,
    listing: wp.array[int],  # (R,)
    numbers: wp.array[int],  # (R,)
    # outputs
    going: wp.array[int],  # (R,)
    spans: wp.array2d[int],  # (R, 2)
    rows: wp.array[int],  # (R,): the first of each ray, in the order of the list
    counts: wp.array[int],  # (2,)
):
    """List the rays that have samples, and assign rows to them, in one thread."""
    total = int(0)
    rays = int(0)
    for i in range(living):
        rows[i] = total
        if numbers[i] > 0:
            going[rays] = listing[i]
            spans[rays, 0] = total
            spans[rays, 1] = numbers[i]
            total += numbers[i]
            rays += 1
    counts[0] = total
    counts[1] = rays


@wp.kernel
def write(
    slab: int,
    first: int,
    last: int,
    rays: Rays,
    space: Space,
    march: March,
    living: int,
    listing: wp.array[int],  # (R,)
    times: wp.array[float],  # (M,)
    numbers: wp.array[int],  # (R,)
    rows: wp.array[int],  # (R,)
    # outputs
    samples: Samples,
):
    """Write the samples that were found on a ray."""
    for i in range(first, last):
        ray = listing[i]
        origin = row(rays.origins, ray)
        direction = row(rays.directions, ray)
        for n in range(numbers[i]):
            t = times[n * living + i]
            step = spacing(t, march.finest, march.cone)
            point = origin + t * direction
            keep_sample(rows[i] + n, ray, point, t, step, space.unbounded, samples)


def march_on(
    rays: codes.Rays,
    space: codes.Space,
    march: codes.March,
    few: int,
    living: int,
    listing: wp.array,
    views: codes.Views,
    going: wp.array,
    spans: wp.array,
    counts: wp.array,
    samples: codes.Samples,
) -> None:
    """List the next samples, `few` at most, of each of the first `living` rays of a list.

    Rays are marched as in `march.steps.march_rays`, without jitter; in all rounds together, a ray
    takes at most `most` samples. The distances and numbers of samples in `views` are updated.
    `going` (R,) is filled with the rays of `listing` (R,) that have samples, `spans` (R, 2) with
    the first row and the number of rows of each of these. `counts` (2,), which were 0, are the
    numbers of samples and of rays. `samples` have room for few * living. The order of the rays in
    the list is not defined, and no result depends on it.
    """
    device = counts.device
    times = scratch("view.times", samples.rays.shape, wp.float32, device)
    given, seen = _march(rays, space, march), struct_of(Views, views)
    found = struct_of(Samples, samples)
    if device.is_cuda:
        inputs = [*given, few, living, listing]
        outputs = [seen, times, going, spans, counts, found]
        launch(cuda.march_on, _threads(living), inputs, outputs)
        return
    numbers, rows = (
        scratch(f"view.{name}", listing.shape, wp.int32, device) for name in ("numbers", "rows")
    )
    parts = slabs(living, 256 * living)
    inputs = [*given, few, living, listing]
    launch_slabs(look_on, living, parts, inputs, [seen, times, numbers])
    launch(place, 1, [living, listing, numbers], [going, spans, rows, counts])
    parts = slabs(living, 64 * living)
    inputs = [*given, living, listing, times, numbers, rows]
    launch_slabs(write, living, parts, inputs, [found])


@wp.kernel
def composite_kernel(
    stride: int,
    first: int,
    last: int,
    sigma: wp.array[float],  # (M,)
    rgb: wp.array2d[float],  # (M, 3)
    distances: wp.array2d[float],  # (M, 2)
    going: wp.array[int],  # (R,)
    spans: wp.array2d[int],  # (R, 2)
    living: int,
    stop: float,
    # outputs
    counts: wp.array[int],  # (2,)
    views: Views,  # the results are added to
):
    """Walk along the samples of a ray."""
    for i in range(first + wp.tid(), wp.min(last, living), stride):
        if i == 0:
            counts[0] = 0
            counts[1] = 0
        ray = going[i]
        c = row(views.color, ray)
        sum_w = views.opacity[ray]
        sum_wt = views.depth[ray]
        s = spans[i, 0]
        end = s + spans[i, 1]
        while s < end and 1.0 - sum_w > stop:
            w = (1.0 - sum_w) * (1.0 - wp.exp(-sigma[s] * distances[s, 1]))
            c += w * row(rgb, s)
            sum_w += w
            sum_wt += w * distances[s, 0]
            s += 1
        for k in range(3):
            views.color[ray, k] = c[k]
        views.opacity[ray] = sum_w
        views.depth[ray] = sum_wt
        if 1.0 - sum_w <= stop:
            views.at[ray] = NEVER


def composite_on(
    sigma: wp.array,
    rgb: wp.array,
    distances: wp.array,
    going: wp.array,
    spans: wp.array,
    living: int,
    stop: float,
    counts: wp.array,
    views: codes.Views,
) -> None:
    """Composite the samples of a round after those of the rounds before.

    `sigma` (M,), `rgb` (M, 3) and `distances` (M, 2) belong to samples; `spans` (R, 2) gives the
    rows of each of the first `living` rays of `going` (R,). They are added to the results so far,
    as in `compositing.forward`. A ray whose light is at most the share `stop` is finished, so its
    distance becomes NEVER. `counts` (2,) are set to 0 for the next round.
    """
    count = _threads(living) if counts.device.is_cuda else living
    inputs = [sigma, rgb, distances, going, spans, living, stop]
    outputs = [counts, struct_of(Views, views)]
    launch_each(composite_kernel, count, 64 * living, inputs, outputs)


@wp.kernel
def finish_kernel(
    stride: int,
    first: int,
    last: int,
    red: float,
    green: float,
    blue: float,
    unit: float,
    solid: float,
    # outputs
    color: wp.array2d[float],  # (R, 3)
    opacity: wp.array[float],  # (R,)
    depth: wp.array[float],  # (R,)
):
    """Finish a pixel."""
    for ray in range(first + wp.tid(), last, stride):
        o = opacity[ray]
        seen = row(color, ray) + (1.0 - o) * wp.vec3(red, green, blue)
        for k in range(3):
            color[ray, k] = wp.clamp(seen[k], 0.0, 1.0)
        mean = float(wp.nan)
        if o >= solid:
            mean = unit * depth[ray] / o
        depth[ray] = mean


def finish(
    red: float,
    green: float,
    blue: float,
    unit: float,
    solid: float,
    color: wp.array,
    opacity: wp.array,
    depth: wp.array,
) -> None:
    """Turn the results of rays into pictures, in place: `color` (R, 3), `opacity`, `depth` (R,).

    Colours are composited over the background and clipped to [0, 1]. Depths become mean distances
    times `unit`, and NaN where the opacity is below `solid`.
    """
    count = opacity.shape[0]
    inputs = [red, green, blue, unit, solid]
    launch_each(finish_kernel, count, 16 * count, inputs, [color, opacity, depth])


def _threads(living: int) -> int:
    """Return the number of threads for a list on CUDA, one of a few numbers of whole blocks.

    Launches are kept by their size, so there should be few sizes.
    """
    return max(BLOCK, 1 << (living - 1).bit_length())
