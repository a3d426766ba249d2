"""Sums of fractions as integers, which do not depend on the order of what is added."""

import warp as wp

wp.set_module_options({"enable_backward": False})

# Half precision has steps of 2^-24, and ends at 65504: what it holds is not lost here, and sums
# of 2^18 such numbers fit.
UNIT = wp.constant(2.0**-28)
LIMIT = wp.constant(2.0**16)  # what is added is cut off here

# For native code on CUDA, of a float `value`.
FIXED = f"__float2ll_rn(fminf(fmaxf(value, -{LIMIT}f), {LIMIT}f) * {1 / UNIT}f)"


@wp.func
def fixed(value: float) -> wp.int64:
    """Return the number in units, rounded."""
    return wp.int64(wp.rint(wp.clamp(value, -LIMIT, LIMIT) / UNIT))
