"""Sums of fractions as integers, which do not depend on the order of what is added."""

import taichi as ti

# Half precision has steps of 2^-24, and ends at 65504: what it holds is not lost here, and sums
# of 2^18 such numbers fit.
UNIT = 2.0**-28
LIMIT = 2.0**16  # what is added is cut off here
# Sums stay within +- this, but for those that a NaN was added to: they are set to -2^63, from where
# no other addends get them back.
BROKEN = 2**62


@ti.func
def fixed(value: ti.f32) -> ti.i64:
    """Return the number in units, rounded."""
    return ti.round(ti.math.clamp(value, -LIMIT, LIMIT) / UNIT, ti.i64)


@ti.func
def fraction(total: ti.i64) -> ti.f32:
    """Return the number that a sum is, or NaN."""
    found = ti.cast(total, ti.f32) * UNIT
    if total >= ti.i64(BROKEN) or total <= ti.i64(-BROKEN):
        found = ti.math.nan
    return found


@ti.func
def add(target: ti.template(), value: ti.f32, exact: ti.template()):
    """Add to a number atomically, or, if `exact`, to one in units."""
    if ti.static(exact):
        if ti.math.isnan(value):
            ti.atomic_min(target, ti.i64(-2 * BROKEN))
        else:
            ti.atomic_add(target, fixed(value))
    else:
        ti.atomic_add(target, value)
