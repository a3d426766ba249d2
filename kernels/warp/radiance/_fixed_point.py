"""Sums of fractions as integers, which do not depend on the order of the summands.

A number v is added as the integer nearest to v / UNIT. _fixed_point.cu has the same for native code
on CUDA, with the constants NATIVE.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

# Half precision has steps of 2^-24 and ends at 65504. This unit represents its numbers exactly, and
# sums of 2^18 such numbers fit.
UNIT = wp.constant(2.0**-28)
LIMIT = wp.constant(2.0**16)  # summands are clipped to this magnitude

# Sums stay within +- this. Adding a NaN sets a sum to -2^63, and no other summands bring it back.
BROKEN = wp.constant(wp.int64(2**62))

NATIVE = {"UNIT": f"{UNIT!r}f", "LIMIT": f"{LIMIT!r}f"}  # constants of _fixed_point.cu


@wp.func
def fraction(total: wp.int64) -> float:
    """Convert a sum to a number, or NaN."""
    if total >= BROKEN or total <= -BROKEN:
        return wp.nan
    return float(total) * UNIT
