"""The order of matches on the CPU: a thread takes a slab of pairs of images.

It sorts the keys of a pair into buckets by their leading bits, then by Shell's method within each.
"""

import warp as wp

from cvkern.kernels.codes import geometry as codes

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BUCKETS = 2048
NUMBER = wp.constant(BUCKETS)
SHIFT = wp.constant(wp.uint64(64 - 11))  # leaves the number of a bucket of a key
INDEX = wp.constant(wp.uint64(codes.MAX_MATCHES - 1))  # the bits of a key that are an index
MULTIPLIER = wp.constant(wp.uint64(0x9E3779B97F4A7C15))
match_t = wp.types.vector(5, wp.float64)


@wp.func
def match_of(points0: wp.array2d[wp.float64], points1: wp.array2d[wp.float64], i: int) -> match_t:
    """Return x0, y0, x1, y1 of a match, and z0 of a scene or 0; both zeros are one."""
    m = match_t()
    if points0.shape[1] == 3:
        for r in range(2):
            m[r] = points0[i, r]
        m[4] = points0[i, 2]
    else:
        for r in range(2):
            m[r] = points0[i, 1 - r]
    for r in range(2):
        m[2 + r] = points1[i, 1 - r]
    for r in range(5):
        if m[r] == wp.float64(0.0):
            m[r] = wp.float64(0.0)
    return m


@wp.func
def mixed_with(code: wp.uint64, value: wp.float64) -> wp.uint64:
    code = (code ^ wp.cast(value, wp.uint64)) * MULTIPLIER
    return code ^ (code >> wp.uint64(29))


@wp.func
def index_of(key: wp.uint64) -> int:
    return int(key & INDEX)


@wp.kernel
def sort_pairs(
    slab: int,
    start: int,
    stop: int,
    points0: wp.array2d[wp.float64],
    points1: wp.array2d[wp.float64],
    spans: wp.array2d[int],
    # scratch
    keys: wp.array[wp.uint64],  # (2 M,)
    heads: wp.array2d[int],  # (slabs, BUCKETS + 1)
    # outputs
    order: wp.array[int],
    places: wp.array[int],
    counts: wp.array[int],
    boxes: wp.array3d[wp.float64],
):
    """Sort the finite matches of each pair, equal ones once; list them, their places, their box."""
    rows = points0.shape[1] + 2
    for pair in range(start, stop):
        first = spans[pair, 0]
        count = spans[pair, 1]
        ahead = 2 * first  # first sorted key
        mixed = ahead + count  # first key before sorting
        for b in range(NUMBER + 1):
            heads[slab, b] = 0
        kept = int(0)
        for i in range(count):
            m = match_of(points0, points1, first + i)
            code = wp.uint64(0)
            for r in range(4):
                code = mixed_with(code, m[r])
            if rows == 5:
                code = mixed_with(code, m[4])
            places[first + i] = -1
            if m - m == match_t():  # all numbers are finite
                key = ((code | INDEX) ^ INDEX) | wp.uint64(i)
                keys[mixed + kept] = key
                heads[slab, int(key >> SHIFT) + 1] += 1
                kept += 1
        for b in range(NUMBER):
            heads[slab, b + 1] += heads[slab, b]
        for i in range(kept):
            key = keys[mixed + i]
            b = int(key >> SHIFT)
            keys[ahead + heads[slab, b]] = key
            heads[slab, b] += 1
        begin = int(0)
        for b in range(NUMBER):
            end = heads[slab, b]
            gap = int(1)
            while gap < (end - begin) // 3:
                gap = 3 * gap + 1
            while gap > 0:
                for i in range(begin + gap, end):
                    key = keys[ahead + i]
                    j = int(i)
                    before = keys[ahead + j - gap]
                    while before > key:
                        keys[ahead + j] = before
                        j -= gap
                        before = wp.uint64(0)  # ends the loop at the head of the bucket
                        if j >= begin + gap:
                            before = keys[ahead + j - gap]
                    keys[ahead + j] = key
                gap = gap // 3
            begin = end
        low = match_t()
        high = match_t()
        number = int(0)
        for k in range(kept):
            key = keys[ahead + k]
            i = index_of(key)
            m = match_of(points0, points1, first + i)
            fresh = bool(True)
            if k > 0:
                before = keys[ahead + k - 1]
                if (key | INDEX) == (before | INDEX):
                    other = match_of(points0, points1, first + index_of(before))
                    fresh = not (other == m)  # vectors have no !=
            if fresh:
                order[first + number] = i
                if number == 0:
                    low = m
                    high = m
                low = wp.min(low, m)
                high = wp.max(high, m)
                number += 1
            places[first + i] = spans[pair, 2] + number - 1
        counts[pair] = number
        for r in range(rows):
            boxes[pair, 0, r] = low[r]
            boxes[pair, 1, r] = high[r]


@wp.kernel
def scale_pairs(
    slab: int,
    start: int,
    stop: int,
    points0: wp.array2d[wp.float64],
    points1: wp.array2d[wp.float64],
    spans: wp.array2d[int],
    order: wp.array[int],
    counts: wp.array[int],
    scales: wp.array3d[wp.float64],
    lanes: int,
    # outputs
    matches: wp.array2d[float],
):
    """Scale the matches of each pair, in their order; there are zeros up to the next pair."""
    rows = matches.shape[0]
    for pair in range(start, stop):
        first = spans[pair, 0]
        to = spans[pair, 2]
        count = counts[pair]
        scale = match_t()
        shift = match_t()
        for r in range(rows):
            scale[r] = scales[pair, 0, r]
            shift[r] = scales[pair, 1, r]
        for k in range(count):
            m = match_of(points0, points1, first + order[first + k])
            scaled = wp.cw_mul(m, scale) - shift
            for r in range(4):
                matches[r, to + k] = float(scaled[r])
            if rows == 5:
                matches[4, to + k] = float(scaled[4])
        for k in range(count, (spans[pair, 1] + lanes - 1) // lanes * lanes):
            for r in range(rows):
                matches[r, to + k] = 0.0
