"""Sums of fractions as integers, which do not depend on the order of what is added.

A number v is added as the integer nearest to v / UNIT. Native code on CUDA has the same in
_fixed_point.cu, and is given NATIVE.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

# Half precision has steps of 2^-24 and ends at 65504: none of its digits is lost here, and a sum of
# 2^18 such numbers fits.
UNIT = wp.constant(2.0**-28)
LIMIT = wp.constant(2.0**16)  # the largest number that is added: others are cut off

# Sums stay within +- this, except for those that a NaN was added to: they are set to -2^63, and no
# other addends bring them back.
BROKEN = wp.constant(wp.int64(2**62))

NATIVE = {"UNIT": f"{UNIT!r}f", "LIMIT": f"{LIMIT!r}f"}  # constants of _fixed_point.cu


@wp.func
def fraction(total: wp.int64) -> float:
    """Return the number that a sum is, or NaN."""
    if total >= BROKEN or total <= -BROKEN:
        return wp.nan
    return float(total) * UNIT
