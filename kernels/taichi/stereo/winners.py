"""The winner among the costs of a pixel, in Taichi.

Let c be the smallest cost, at index k, and r the smallest cost more than one index away. The winner
is unique unless r (100 - uniqueness) < 100 c, and its confidence is 1 - c / r. Let a and b be the
two neighbouring costs minus c. A parabola gives the disparity first + k + (a - b) / (2 (a + b)),
and two lines of opposite slope give first + k + (a - b) / (2 max(a, b)) (D. Scharstein and R.
Szeliski, IJCV 47, 2002). One thread per pixel.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.stereo import Rule, Subpixel, Winners
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._rounding import quotient

any_3 = ti.types.ndarray(ndim=3)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)


@ti.kernel
def _largest(
    costs: any_3,  # (H, W, D)
    # outputs
    most: i32_2,  # (H, W)
):
    for y, x in most:
        m = 0
        for d in range(costs.shape[2]):
            m = ti.max(m, ti.cast(costs[y, x, d], ti.i32))
        most[y, x] = m


@primitive
def largest(costs: np.ndarray, most: np.ndarray) -> None:
    """Find the largest cost of each pixel; one thread per pixel."""
    _largest(costs, most)


@ti.func
def _cost(value: ti.template()) -> ti.f32:
    """Return a cost as float32; infinite for NaN."""
    c = ti.cast(value, ti.f32)
    if not c < ti.math.inf:
        c = ti.math.inf
    return c


@ti.kernel
def _pick(
    costs: any_3,  # (H, W, D)
    first: ti.i32,
    subpixel: ti.i32,
    uniqueness: ti.i32,
    zero: ti.i32,
    # outputs, all (H, W)
    index: i32_2,
    disparity: f32_2,
    cost: f32_2,
    confidence: f32_2,
):
    # Float32 holds integer costs, and the products with percentages below, exactly.
    depth = costs.shape[2]
    for y, x in index:
        best = ti.math.inf
        k = 0
        for d in range(depth):
            c = _cost(costs[y, x, d])
            if c < best:
                best = c
                k = d
        second = ti.math.inf
        for d in range(depth):
            if ti.abs(d - k) > 1:
                second = ti.min(second, _cost(costs[y, x, d]))
        cost[y, x] = best
        certain = 0.0
        if second > best:
            share = 1.0 - quotient(best, second, zero)
            if best == -ti.math.inf:  # the share has no bound
                certain = 1.0
            elif share > 0.0:  # not where it is NaN
                certain = ti.min(share, 1.0)
        confidence[y, x] = certain
        if uniqueness > 0 and second * (100.0 - uniqueness) < best * 100.0:
            index[y, x] = -1
            disparity[y, x] = ti.bit_cast(0x7FC00000, ti.f32)  # NaN, with these bits everywhere
        else:
            offset = 0.0
            if subpixel != Subpixel.NONE and 0 < k < depth - 1:
                a = _cost(costs[y, x, k - 1]) - best
                b = _cost(costs[y, x, k + 1]) - best
                n = a - b
                m = a + b if subpixel == Subpixel.PARABOLA else ti.max(a, b)
                if 0.0 < m < ti.math.inf and ti.abs(n) < ti.math.inf:
                    offset = 0.5 * quotient(n, m, zero)
            index[y, x] = k
            disparity[y, x] = ti.cast(first + k, ti.f32) + offset


@primitive
def pick(costs: np.ndarray, rule: Rule, winners: Winners) -> None:
    """Find the winner of each pixel; one thread per pixel."""
    _pick(costs, *rule, 0, *winners)


@ti.kernel
def _pick_right(
    costs: any_3,  # (H, W, D)
    first: ti.i32,
    # outputs
    index: i32_2,  # (H, W)
):
    for y, x in index:
        best = ti.math.inf
        k = -1
        for d in range(costs.shape[2]):
            left = x + first + d
            if 0 <= left < costs.shape[1]:
                c = _cost(costs[y, left, d])
                if k < 0 or c < best:
                    best = c
                    k = d
        index[y, x] = k


@primitive
def pick_right(costs: np.ndarray, first: int, index: np.ndarray) -> None:
    """Find the index of the smallest cost of each right pixel; one thread per pixel."""
    _pick_right(costs, first, index)
