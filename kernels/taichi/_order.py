"""Floats as integers of the same order, so that atomics and sorting of integers serve them."""

import taichi as ti


@ti.func
def ordered(bits: ti.i32) -> ti.i32:
    """Turn the bits of a float32 into an integer of the same order, or such an integer back.

    The bits of negative numbers below the sign are inverted.
    """
    return bits ^ 0x7FFFFFFF if bits < 0 else bits


@ti.func
def key_of(value: ti.f32) -> ti.i64:
    """Return an integer above 0 and below 2^32, of the same order as finite values."""
    return ti.cast(ordered(ti.bit_cast(value, ti.i32)), ti.i64) + ti.i64(2**31)
