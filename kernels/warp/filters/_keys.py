"""Floats as integers of the same order, on every device."""

import warp as wp

from cvkern.kernels.warp._order import ordered

wp.set_module_options({"enable_backward": False})


@wp.kernel
def keys_of_floats(
    bits: wp.array[int],
    # outputs
    keys: wp.array[int],
):
    i = wp.tid()
    b = bits[i]
    if (b & 0x7FFFFFFF) > 0x7F800000:  # a NaN of any sign is placed above infinity
        b = 0x7FC00000
    keys[i] = ordered(b)


@wp.kernel
def floats_of_keys(
    keys: wp.array[int],
    # outputs
    bits: wp.array[int],
):
    i = wp.tid()
    bits[i] = ordered(keys[i])
