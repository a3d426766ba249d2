"""A ray's next few samples, on every device."""

import warp as wp

from ._space import interval, reciprocal, row, skip, spacing


@wp.func
def look(
    origins: wp.array2d[float],
    directions: wp.array2d[float],
    bits: wp.array[wp.uint32],
    levels: int,
    cells: int,
    far: float,
    finest: float,
    cone: float,
    most: int,
    few: int,
    living: int,
    i: int,
    ray: int,
    # outputs
    at: wp.array[float],
    taken: wp.array[int],
    times: wp.array[float],
) -> int:
    """Find the next samples of the ray that is i-th in a list, and have it go on behind the last.

    Their distances go to `times`, the first ones of all rays first. Returns their number.
    """
    origin = row(origins, ray)
    direction = row(directions, ray)
    inverse = reciprocal(direction)
    end = wp.min(far, interval(origin, inverse, float(1 << (levels - 1)))[1])
    t = at[ray]
    limit = wp.min(few, most - taken[ray])
    count = int(0)
    while t < end and count < limit:
        next = skip(origin, direction, inverse, bits, levels, cells, t, finest, cone)
        if next == t:
            times[count * living + i] = t
            count += 1
            next = t + spacing(t, finest, cone)
        t = next
    at[ray] = t
    taken[ray] = taken[ray] + count
    return count
