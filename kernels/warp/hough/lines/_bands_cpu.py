"""Lines with many votes on the CPU: votes and their maxima angle by angle, without an accumulator.

Points are sorted by their directions, so that the voters of an angle follow one another. A slab of
angles keeps the votes of a few neighbouring angles only, which stay in the cache.
"""

import warp as wp

from cvkern.kernels.codes.hough import DIRECTIONS
from cvkern.kernels.warp import _native
from cvkern.kernels.warp.hough._directions import direction_code

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

CODES = DIRECTIONS // 2  # half a turn
LAST_CODE = wp.constant(CODES - 1)
POINTS = 64  # points at a time
LANES = 32  # bins at a time


@wp.struct
class Voters:
    """Points sorted by direction, the codes that vote for each of T angles, and their tables."""

    points: wp.array2d[int]  # (capacity, 2)
    begins: wp.array[int]  # (CODES + 2,): where the points of each code begin; then their number
    codes: wp.array2d[int]  # (T, 2): the first code, and the one after the last, of a ring
    cosine: wp.array[int]  # (T + up to 7,)
    sine: wp.array[int]
    offset: wp.array[wp.int64]


@wp.kernel
def sort_by_direction(
    points: wp.array2d[int],  # (capacity, 2)
    starts: wp.array[int],  # its last element is the number of points
    orientation: wp.array[float],  # (capacity,)
    # scratch
    turned: wp.array[int],  # (capacity,)
    # outputs
    begins: wp.array[int],  # (CODES + 2,): where the points of each code begin; then their number
    voters: wp.array2d[int],  # (capacity, 2)
):
    number = starts[starts.shape[0] - 1]
    for code in range(begins.shape[0]):
        begins[code] = 0
    for i in range(number):
        code = direction_code(orientation[i]) & LAST_CODE
        turned[i] = code
        begins[code + 2] = begins[code + 2] + 1
    for code in range(1, begins.shape[0]):
        begins[code] = begins[code] + begins[code - 1]
    for i in range(number):
        code = turned[i]
        place = begins[code + 1]
        begins[code + 1] = place + 1
        voters[place, 0] = points[i, 0]
        voters[place, 1] = points[i, 1]


@wp.kernel
def find_codes(
    first: wp.array[int],  # (CODES,): the first angle that a code votes for
    number: wp.array[int],  # (CODES,): the number of angles, 1 or more
    # outputs
    codes: wp.array2d[
        int
    ],  # (T, 2): the first code that votes for an angle, the one after the last
):
    angles = codes.shape[0]
    begin = first[LAST_CODE]
    end = (begin + number[LAST_CODE]) % angles
    for t in range(angles):
        ahead = (t - begin + angles) % angles
        none = wp.where(ahead < number[LAST_CODE], 0, LAST_CODE + 1)
        codes[t, 0] = none
        codes[t, 1] = none + wp.min(none, 1)
    for code in range(LAST_CODE + 1):  # the window of the next code begins and ends a little later
        while begin != first[code]:
            codes[begin, 1] = code
            begin = (begin + 1) % angles
        while end != (first[code] + number[code]) % angles:
            codes[end, 0] = code
            end = (end + 1) % angles


@wp.kernel
def collect(
    found: wp.array2d[wp.int64],  # (slabs, a slab's room)
    counts: wp.array[int],  # (slabs,)
    # outputs
    keys: wp.array[wp.int64],
    total: wp.array[int],  # (1,)
):
    place = int(0)
    for slab in range(counts.shape[0]):
        for i in range(counts[slab]):
            keys[place] = found[slab, i]
            place += 1
    total[0] = place


@_native.kernel("_bands_cpu.h", POINTS=POINTS, LANES=LANES)
def find_peaks(
    slab: int,
    first: int,
    last: int,
    voters: Voters,
    shift: int,
    limits: wp.vec4i,  # bins, threshold, and distance of peaks in bins of rho and of theta
    # scratch
    lines: wp.array2d[
        int
    ],  # (slabs (2 min_angle + 1), bins, rounded up, and margins of the distance)
    # outputs
    keys: wp.array2d[wp.int64],  # (slabs, a slab's room)
    counts: wp.array[int],  # (slabs,)
): ...
