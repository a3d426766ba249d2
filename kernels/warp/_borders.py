"""Border rules, shared by every Warp family."""

import warp as wp

from cvkern.kernels.codes.filters import Border


@wp.func
def border_index(i: int, n: int, border: int) -> int:
    """Map index `i` into [0, n), or to -1 for CONSTANT. Rules as in scipy.ndimage."""
    if i >= 0 and i < n:
        return i
    if border == Border.CONSTANT:
        return -1
    if border == Border.NEAREST:
        return wp.clamp(i, 0, n - 1)
    if border == Border.WRAP:
        return i - wp.floordiv(i, n) * n
    if n == 1:
        return 0
    # REFLECT repeats the edge (period 2 n), MIRROR does not (period 2 n - 2).
    last = n - 1
    period = 2 * n - 2
    if border == Border.REFLECT:
        period = 2 * n
    j = i - wp.floordiv(i, period) * period
    if j > last:
        j = period - j
        if border == Border.REFLECT:
            j -= 1
    return j
