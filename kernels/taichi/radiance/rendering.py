"""Views of a field of samples, in Taichi, in rounds that process the next few samples of each ray.

A ray has the distance at which it continues, its number of samples so far, and its result so far. A
list holds the numbers of the active rays. Each round makes a new list without the rays that left
the field, or whose light is down to the share `stop`. The samples of a ray are those of
march/steps.py; they do not depend on the number per round. One thread per ray.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.taichi._launch import primitive

from ._space import in_cube, interval, keep_sample, place, reach, reciprocal, row, skip, spacing
from ._structs import March, Round, march_of

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
u32_1 = ti.types.ndarray(dtype=ti.u32, ndim=1)
vec3 = ti.types.vector(3, ti.f32)

NEVER = 1.0e30  # the distance of a ray that is finished


@ti.kernel
def _clear(counts: i32_1):
    for i in counts:
        counts[i] = 0


@ti.kernel
def _set_out(
    origins: f32_2,  # (R, 3)
    directions: f32_2,  # (R, 3)
    march: March,
    zero: ti.i32,
    # outputs
    at: f32_1,  # (R,)
    taken: i32_1,  # (R,)
    listing: i32_1,  # (R,)
    color: f32_2,  # (R, 3)
    opacity: f32_1,  # (R,)
    depth: f32_1,  # (R,)
):
    for ray in range(origins.shape[0]):
        inverse = reciprocal(row(directions, ray), zero)
        origin = row(origins, ray)
        at[ray] = reach(origin, inverse, march, 0.5, zero)[0]
        taken[ray] = 0
        listing[ray] = ray
        for k in ti.static(range(3)):
            color[ray, k] = 0.0
        opacity[ray] = 0.0
        depth[ray] = 0.0


@primitive
def set_out(
    rays: codes.Rays,
    space: codes.Space,
    march: codes.March,
    listing: np.ndarray,
    counts: np.ndarray,
    views: codes.Views,
) -> None:
    """Begin the views of all R rays; `active` is ignored.

    A ray begins where `march.steps.march_rays` begins without jitter. `listing` (R,) holds all
    rays; the rest of `views`, and `counts` (2,), are set to 0.
    """
    outputs = views.at, views.taken, listing, views.color, views.opacity, views.depth
    _set_out(rays.origins, rays.directions, march_of(space, march), 0, *outputs)
    _clear(counts)


@ti.kernel
def _count_next(
    origins: f32_2,  # (R, 3)
    directions: f32_2,  # (R, 3)
    bits: u32_1,  # (levels cells^3 / 32,)
    march: March,
    round: Round,
    listing: i32_1,  # (R,)
    zero: ti.i32,
    # outputs
    at: f32_1,  # (R,): moved on to the first of the samples
    taken: i32_1,  # (R,)
    going: i32_1,  # (R,)
    spans: i32_2,  # (R, 2)
    counts: i32_1,  # (2,): 0, added to
):
    for i in range(round.living):
        ray = listing[i]
        origin = row(origins, ray)
        direction = row(directions, ray)
        inverse = reciprocal(direction, zero)
        side = ti.cast(1 << (march.levels - 1), ti.f32)
        last = ti.min(march.far, interval(origin, inverse, side, zero)[1])
        limit = ti.min(round.few, march.most - taken[ray])
        t = at[ray]
        count = 0
        while t < last and count < limit:
            next = skip(origin, direction, inverse, bits, march, t, zero)
            if next == t:
                if count == 0:
                    at[ray] = t
                count += 1
                next = t + spacing(t, march, zero)
            t = next
        if count > 0:
            taken[ray] += count
            entry = ti.atomic_add(counts[1], 1)
            going[entry] = ray
            spans[entry, 0] = ti.atomic_add(counts[0], count)
            spans[entry, 1] = count


@ti.kernel
def _write_next(
    origins: f32_2,  # (R, 3)
    directions: f32_2,  # (R, 3)
    bits: u32_1,  # (levels cells^3 / 32,)
    march: March,
    going: i32_1,  # (R,)
    spans: i32_2,  # (R, 2)
    counts: i32_1,  # (2,)
    zero: ti.i32,
    # outputs
    at: f32_1,  # (R,): moved on behind the samples
    positions: f32_2,  # (M, 3)
    distances: f32_2,  # (M, 2)
    rays: i32_1,  # (M,)
):
    for i in range(counts[1]):
        ray = going[i]
        origin = row(origins, ray)
        direction = row(directions, ray)
        inverse = reciprocal(direction, zero)
        sample = spans[i, 0]
        end = sample + spans[i, 1]
        t = at[ray]
        while sample < end:
            next = skip(origin, direction, inverse, bits, march, t, zero)
            if next == t:
                step = spacing(t, march, zero)
                point = place(origin, t, direction, zero)
                cube = in_cube(point, march.unbounded)
                keep_sample(sample, ray, cube, t, step, positions, distances, rays)
                sample += 1
                next = t + step
            t = next
        at[ray] = t


@primitive
def march_on(
    rays: codes.Rays,
    space: codes.Space,
    march: codes.March,
    few: int,
    living: int,
    listing: np.ndarray,
    views: codes.Views,
    going: np.ndarray,
    spans: np.ndarray,
    counts: np.ndarray,
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
    given = rays.origins, rays.directions, space.bits, march_of(space, march)
    found = going, spans, counts
    _count_next(*given, Round(few=few, living=living), listing, 0, views.at, views.taken, *found)
    _write_next(*given, *found, 0, views.at, *samples)


@ti.kernel
def _composite_on(
    sigma: f32_1,  # (M,)
    rgb: f32_2,  # (M, 3)
    distances: f32_2,  # (M, 2)
    going: i32_1,  # (R,)
    spans: i32_2,  # (R, 2)
    living: ti.i32,
    stop: ti.f32,
    # outputs
    at: f32_1,  # (R,)
    color: f32_2,  # (R, 3): added to, as the others
    opacity: f32_1,  # (R,)
    depth: f32_1,  # (R,)
):
    for i in range(living):
        ray = going[i]
        c = row(color, ray)
        sum_w = opacity[ray]
        sum_wt = depth[ray]
        s = spans[i, 0]
        end = s + spans[i, 1]
        while s < end and 1.0 - sum_w > stop:
            w = (1.0 - sum_w) * (1.0 - ti.exp(-sigma[s] * distances[s, 1]))
            c += w * row(rgb, s)
            sum_w += w
            sum_wt += w * distances[s, 0]
            s += 1
        for k in ti.static(range(3)):
            color[ray, k] = c[k]
        opacity[ray] = sum_w
        depth[ray] = sum_wt
        if 1.0 - sum_w <= stop:
            at[ray] = NEVER


@primitive
def composite_on(
    sigma: np.ndarray,
    rgb: np.ndarray,
    distances: np.ndarray,
    going: np.ndarray,
    spans: np.ndarray,
    living: int,
    stop: float,
    counts: np.ndarray,
    views: codes.Views,
) -> None:
    """Composite the samples of a round after those of the rounds before.

    `sigma` (M,), `rgb` (M, 3) and `distances` (M, 2) belong to samples; `spans` (R, 2) gives the
    rows of each of the first `living` rays of `going` (R,). They are added to the results so far,
    as in `compositing.forward`. A ray whose light is at most the share `stop` is finished, so its
    distance becomes NEVER. `counts` (2,) are set to 0 for the next round.
    """
    inputs = sigma, rgb, distances, going, spans, living, stop
    _composite_on(*inputs, views.at, views.color, views.opacity, views.depth)
    _clear(counts)


@ti.kernel
def _finish(
    red: ti.f32,
    green: ti.f32,
    blue: ti.f32,
    unit: ti.f32,
    solid: ti.f32,
    # outputs
    color: f32_2,  # (R, 3)
    opacity: f32_1,  # (R,)
    depth: f32_1,  # (R,)
):
    for ray in opacity:
        o = opacity[ray]
        seen = row(color, ray) + (1.0 - o) * vec3(red, green, blue)
        for k in ti.static(range(3)):
            color[ray, k] = ti.math.clamp(seen[k], 0.0, 1.0)
        mean = ti.math.nan
        if o >= solid:
            mean = unit * depth[ray] / o
        depth[ray] = mean


@primitive
def finish(
    red: float,
    green: float,
    blue: float,
    unit: float,
    solid: float,
    color: np.ndarray,
    opacity: np.ndarray,
    depth: np.ndarray,
) -> None:
    """Turn the results of rays into pictures, in place: `color` (R, 3), `opacity`, `depth` (R,).

    Colours are composited over the background and clipped to [0, 1]. Depths become mean distances
    times `unit`, and NaN where the opacity is below `solid`.
    """
    _finish(red, green, blue, unit, solid, color, opacity, depth)
