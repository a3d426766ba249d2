"""Counter-based random numbers: equal seed, step and item give equal numbers on every device.

`which` selects one of the numbers of an item, as `codes.radiance.Draw` lists them.
"""

import warp as wp

INCREMENT = wp.constant(wp.uint32(2891336453))  # compilers warn of a 32-bit literal


@wp.func
def mix(x: wp.uint32) -> wp.uint32:
    """Scramble an integer [Jarzynski and Olano, "Hash functions for GPU rendering", 2020: PCG]."""
    state = x * wp.uint32(747796405) + INCREMENT
    shift = (state >> wp.uint32(28)) + wp.uint32(4)
    word = ((state >> shift) ^ state) * wp.uint32(277803737)
    return (word >> wp.uint32(22)) ^ word


@wp.func
def random_bits(seed: int, step: int, item: int, which: int) -> wp.uint32:
    """Return 32 random bits for one of several numbers of an item."""
    # The multiplier spreads the few values of `which` over all bits of the seed.
    x = mix(wp.uint32(seed) ^ wp.uint32(0x1E3779B9) * wp.uint32(which))
    return mix(wp.uint32(item) + mix(wp.uint32(step) + x))


@wp.func
def random_unit(seed: int, step: int, item: int, which: int) -> float:
    """Return a number in [0, 1), in steps of 2^-24."""
    return float(random_bits(seed, step, item, which) >> wp.uint32(8)) * (1.0 / 16777216.0)


@wp.func
def random_index(seed: int, step: int, item: int, which: int, count: int) -> int:
    """Return an integer in [0, count), for counts far below 2^32."""
    product = wp.uint64(random_bits(seed, step, item, which)) * wp.uint64(count)
    return int(product >> wp.uint64(32))
