"""Classification of floats by their bits."""

import taichi as ti

# Floats are classified by their bits, because the CUDA compiler assumes that there is no NaN.
INFINITY, NAN, MAGNITUDE = 0x7F800000, 0x7FC00000, 0x7FFFFFFF


@ti.func
def none() -> ti.f32:
    """Return the NaN that means no disparity."""
    return ti.bit_cast(NAN, ti.f32)


@ti.func
def is_finite(value: ti.f32) -> ti.i32:
    """Tell whether a value is neither NaN nor infinite."""
    return (ti.bit_cast(value, ti.i32) & MAGNITUDE) < INFINITY


@ti.func
def is_number(value: ti.f32) -> ti.i32:
    """Tell whether a value is not NaN."""
    return (ti.bit_cast(value, ti.i32) & MAGNITUDE) <= INFINITY
