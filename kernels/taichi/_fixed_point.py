"""Sums of fractions as integers, which do not depend on the order of what is added."""

import taichi as ti

# Half precision has steps of 2^-24, and ends at 65504: what it holds is not lost here, and sums
# of 2^18 such numbers fit.
UNIT = 2.0**-28
LIMIT = 2.0**16  # what is added is cut off here


@ti.func
def fixed(value: ti.f32) -> ti.i64:
    """Return the number in units, rounded."""
    return ti.round(ti.math.clamp(value, -LIMIT, LIMIT) / UNIT, ti.i64)


@ti.func
def add(target: ti.template(), value: ti.f32, exact: ti.template()):
    """Add to a number atomically, or, if `exact`, to one in units."""
    if ti.static(exact):
        ti.atomic_add(target, fixed(value))
    else:
        ti.atomic_add(target, value)
