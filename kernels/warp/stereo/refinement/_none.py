"""NaN with the same bits on every device."""

import warp as wp

# CUDA's own NaN has other bits than the CPU's.
NAN_BITS = wp.constant(0x7FC00000)


@wp.func
def none() -> float:
    """Return the NaN that means no disparity."""
    return wp.cast(NAN_BITS, float)
