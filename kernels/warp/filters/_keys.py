"""Floats as integers of the same order, on every device."""

import warp as wp

from cvkern.kernels.warp._lanes_cpu import LANES
from cvkern.kernels.warp._order import ordered

wp.set_module_options({"enable_backward": False})


i32_lanes = wp.types.vector(LANES, wp.int32)


@wp.func
def _key(b: int) -> int:
    if (b & 0x7FFFFFFF) > 0x7F800000:  # a NaN of any sign is placed above infinity
        b = 0x7FC00000
    return ordered(b)


@wp.kernel
def keys_of_floats(
    bits: wp.array[int],
    # outputs
    keys: wp.array[int],
):
    i = wp.tid()
    keys[i] = _key(bits[i])


@wp.kernel
def keys_of_lanes(
    slab: int,
    first: int,
    last: int,
    bits: wp.array2d[i32_lanes],  # (1, N)
    # outputs
    keys: wp.array2d[i32_lanes],
):
    for lane in range(first, last):
        b = bits[0, lane * LANES]
        found = i32_lanes()
        for k in range(LANES):
            found[k] = _key(b[k])
        keys[0, lane * LANES] = found


@wp.kernel
def lanes_of_keys(
    slab: int,
    first: int,
    last: int,
    keys: wp.array2d[i32_lanes],  # (1, N)
    # outputs
    bits: wp.array2d[i32_lanes],
):
    for lane in range(first, last):
        b = keys[0, lane * LANES]
        found = i32_lanes()
        for k in range(LANES):
            found[k] = ordered(b[k])
        bits[0, lane * LANES] = found


@wp.kernel
def floats_of_keys(
    keys: wp.array[int],
    # outputs
    bits: wp.array[int],
):
    i = wp.tid()
    bits[i] = ordered(keys[i])
