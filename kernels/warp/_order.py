"""Floats as integers of the same order, so that atomics and sorting of integers serve them."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_BELOW_SIGN = wp.constant(0x7FFFFFFF)
_HALF = wp.constant(wp.int64(2**31))


@wp.func
def ordered(bits: int) -> int:
    """Turn the bits of a float32 into an integer of the same order, or such an integer back.

    The bits of negative numbers below the sign are inverted.
    """
    return wp.where(bits < 0, bits ^ _BELOW_SIGN, bits)


@wp.func
def key_of(value: float) -> wp.int64:
    """Return an integer above 0 and below 2^32, of the same order as finite values."""
    return wp.int64(ordered(wp.cast(value, wp.int32))) + _HALF
