"""Sums of fractions as integers, which do not depend on the order of the summands."""

import taichi as ti

# Half precision has steps of 2^-24 and ends at 65504. This unit represents its numbers exactly, and
# sums of 2^18 such numbers fit.
UNIT = 2.0**-28
LIMIT = 2.0**16  # summands are clipped to this magnitude
# Sums stay within +- this. Adding a NaN sets a sum to -2^63, and no other summands bring it back.
BROKEN = 2**62


@ti.func
def fixed(value: ti.f32) -> ti.i64:
    """Return the number in units of UNIT, rounded."""
    return ti.round(ti.math.clamp(value, -LIMIT, LIMIT) / UNIT, ti.i64)


@ti.func
def fraction(total: ti.i64) -> ti.f32:
    """Convert a sum to a number, or NaN."""
    found = ti.cast(total, ti.f32) * UNIT
    if total >= ti.i64(BROKEN) or total <= ti.i64(-BROKEN):
        found = ti.math.nan
    return found


@ti.func
def add(target: ti.template(), value: ti.f32, exact: ti.template()):
    """Add to a number atomically; if `exact`, the target is in units of UNIT."""
    if ti.static(exact):
        if ti.math.isnan(value):
            ti.atomic_min(target, ti.i64(-2 * BROKEN))
        else:
            ti.atomic_add(target, fixed(value))
    else:
        ti.atomic_add(target, value)
