"""Counter-based random numbers: equal seed, step and item give equal numbers on every device.

`which` selects one of the numbers of an item, as `codes.radiance.Draw` lists them.
"""

import taichi as ti


@ti.func
def mix(x: ti.u32) -> ti.u32:
    """Scramble an integer [Jarzynski and Olano, "Hash functions for GPU rendering", 2020: PCG]."""
    state = x * ti.u32(747796405) + ti.u32(2891336453)
    shift = (state >> ti.u32(28)) + ti.u32(4)
    word = ((state >> shift) ^ state) * ti.u32(277803737)
    return (word >> ti.u32(22)) ^ word


@ti.func
def random_bits(seed: ti.i32, step: ti.i32, item: ti.i32, which: ti.i32) -> ti.u32:
    """Return 32 random bits for one of several numbers of an item."""
    # The multiplier spreads the few values of `which` over all bits of the seed.
    x = mix(ti.cast(seed, ti.u32) ^ ti.u32(0x1E3779B9) * ti.cast(which, ti.u32))
    return mix(ti.cast(item, ti.u32) + mix(ti.cast(step, ti.u32) + x))


@ti.func
def random_unit(seed: ti.i32, step: ti.i32, item: ti.i32, which: ti.i32) -> ti.f32:
    """Return a number in [0, 1), in steps of 2^-24."""
    return ti.cast(random_bits(seed, step, item, which) >> ti.u32(8), ti.f32) * (1.0 / 16777216.0)


@ti.func
def random_index(seed: ti.i32, step: ti.i32, item: ti.i32, which: ti.i32, count: ti.i32) -> ti.i32:
    """Return an integer in [0, count), for counts far below 2^32."""
    product = ti.cast(random_bits(seed, step, item, which), ti.u64) * ti.cast(count, ti.u64)
    return ti.cast(product >> ti.u64(32), ti.i32)
