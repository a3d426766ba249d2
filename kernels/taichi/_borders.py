"""Border rules, shared by every Taichi family."""

import taichi as ti

from cvkern.kernels.codes.filters import Border


@ti.func
def border_index(i: ti.i32, n: ti.i32, border: ti.i32) -> ti.i32:
    """Map index `i` into [0, n), or to -1 for CONSTANT. Rules as in scipy.ndimage."""
    j = i
    if i < 0 or i >= n:
        if border == Border.CONSTANT:
            j = -1
        elif border == Border.NEAREST:
            j = ti.math.clamp(i, 0, n - 1)
        elif border == Border.WRAP:
            j = i % n
        elif border == Border.REFLECT:  # repeats the edge: period 2 n
            j = i % (2 * n)
            if j >= n:
                j = 2 * n - 1 - j
        elif n == 1:
            j = 0
        else:  # MIRROR does not: period 2 n - 2
            j = i % (2 * n - 2)
            if j >= n:
                j = 2 * n - 2 - j
    return j
