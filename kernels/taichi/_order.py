"""Floats as integers of the same order, so that atomics and sorting of integers serve them."""

import taichi as ti


@ti.func
def ordered(bits: ti.i32) -> ti.i32:
    """Turn the bits of a float32 into an integer of the same order, or such an integer back.

    The bits of negative numbers below the sign are inverted.
    """
    return bits ^ 0x7FFFFFFF if bits < 0 else bits
