"""A ray's next few samples, on every device."""

import warp as wp

from ._space import interval, reciprocal, row, skip, spacing
from ._structs import March, Rays, Space, Views


@wp.func
def look(
    rays: Rays,
    space: Space,
    march: March,
    few: int,
    living: int,
    i: int,
    ray: int,
    # outputs
    views: Views,
    times: wp.array[float],
) -> int:
    """Find the next samples of the i-th ray of a list, and move the ray behind the last of them.

    Their distances are written to `times`, where the first ones of all rays come first. Return
    their number.
    """
    origin = row(rays.origins, ray)
    direction = row(rays.directions, ray)
    inverse = reciprocal(direction)
    side = float(1 << (space.levels - 1))
    end = wp.min(march.far, interval(origin, inverse, side)[1])
    t = views.at[ray]
    limit = wp.min(few, march.most - views.taken[ray])
    count = int(0)
    while t < end and count < limit:
        next = skip(origin, direction, inverse, space, march, t)
        if next == t:
            times[count * living + i] = t
            count += 1
            next = t + spacing(t, march.finest, march.cone)
        t = next
    views.at[ray] = t
    views.taken[ray] = views.taken[ray] + count
    return count
