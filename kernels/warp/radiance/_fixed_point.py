"""Sums of fractions as integers, which do not depend on the order of what is added."""

import warp as wp

wp.set_module_options({"enable_backward": False})

# Half precision has steps of 2^-24, and ends at 65504: what it holds is not lost here, and sums
# of 2^18 such numbers fit.
UNIT = wp.constant(2.0**-28)
LIMIT = wp.constant(2.0**16)  # what is added is cut off here

# Sums stay within +- this, but for those that a NaN was added to: they are set to -2^63, from where
# no other addends get them back.
BROKEN = wp.constant(wp.int64(2**62))

# For native code on CUDA: add a float `value` at `to`.
ADD_FIXED = f"""
    if (value == value)
        atomicAdd((unsigned long long*)to, (unsigned long long)__float2ll_rn(
            fminf(fmaxf(value, -{LIMIT}f), {LIMIT}f) * {1 / UNIT}f));
    else
        atomicExch((unsigned long long*)to, 1ull << 63);
"""

# And a function that makes a float of a sum.
FRACTION = f"""
    auto fraction = [](long long sum) {{
        const bool broken = sum >= 1ll << 62 || sum <= -(1ll << 62);
        return broken ? __int_as_float(0x7fffffff) : __ll2float_rn(sum) * {UNIT}f;
    }};
"""


@wp.func
def fraction(total: wp.int64) -> float:
    """Return the number that a sum is, or NaN."""
    if total >= BROKEN or total <= -BROKEN:
        return wp.nan
    return float(total) * UNIT
