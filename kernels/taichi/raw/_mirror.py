"""Places beyond a border."""

import taichi as ti


@ti.func
def mirror(i: ti.i32, n: ti.i32) -> ti.i32:
    """Return the place within n that place i is the mirror image of, at the last element."""
    period = ti.max(2 * n - 2, 1)
    j = ti.abs(i) % period
    if j >= n:
        j = period - j
    return j
