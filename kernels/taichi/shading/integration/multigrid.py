"""Conjugate gradients, and a multigrid cycle that preconditions them, in Taichi.

A cycle on a level: relax the pixels of one colour of a chess board, then of the other; solve for
the rest on a coarser level of blocks of 2 x 2 pixels, by the same cycle; add this, and relax both
colours in the opposite order [Briggs, Henson and McCormick, "A multigrid tutorial", 2000]. Between
two blocks the weight is that of the edges across their border, in series with half of the edges
within the blocks, so no edge across a jump joins its sides. One thread takes a pixel or a block.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.shading import CHUNKS
from cvkern.kernels.taichi._launch import primitive

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
f64_1 = ti.types.ndarray(dtype=ti.f64, ndim=1)
f64_2 = ti.types.ndarray(dtype=ti.f64, ndim=2)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)


@ti.func
def _series(
    weights: ti.template(), inside: ti.template(), axis: ti.template(), y: ti.i32, x: ti.i32
) -> ti.f32:
    """Return the weight of an edge between blocks: half of those within, in series with it.

    (y, x) is the pixel before the edge.
    """
    dv = axis
    du = 1 - axis
    weight = weights[axis, y, x]
    if weight > 0.0:
        resistance = 1.0 / weight
        if inside[y - dv, x - du] != 0:
            resistance += 0.5 / ti.max(weights[axis, y - dv, x - du], 0.01 * weight)
        v = y + 2 * dv
        u = x + 2 * du
        if v < inside.shape[0] and u < inside.shape[1]:
            if inside[v, u] != 0:
                resistance += 0.5 / ti.max(weights[axis, y + dv, x + du], 0.01 * weight)
        weight = 1.0 / resistance
    return weight


@ti.kernel
def _coarsen(weights: f32_3, inside: u8_2, coarse: f32_3, coarse_inside: u8_2):
    for y, x in coarse_inside:
        count = 0
        right = 0.0
        below = 0.0
        for k in range(2):
            for j in range(2):
                if 2 * y + k < inside.shape[0] and 2 * x + j < inside.shape[1]:
                    count += ti.cast(inside[2 * y + k, 2 * x + j], ti.i32)
            if 2 * x + 2 < inside.shape[1] and 2 * y + k < inside.shape[0]:
                right += _series(weights, inside, 0, 2 * y + k, 2 * x + 1)
            if 2 * y + 2 < inside.shape[0] and 2 * x + k < inside.shape[1]:
                below += _series(weights, inside, 1, 2 * y + 1, 2 * x + k)
        coarse[0, y, x] = right
        coarse[1, y, x] = below
        coarse_inside[y, x] = ti.cast(count > 0, ti.u8)


@primitive
def coarsen(
    weights: np.ndarray, inside: np.ndarray, coarse: np.ndarray, coarse_inside: np.ndarray
) -> None:
    """Write the edges of blocks of 2 x 2 pixels, and where there are such."""
    _coarsen(weights, inside, coarse, coarse_inside)


@ti.func
def _neighbours(weights: ti.template(), x: ti.template(), v: ti.i32, u: ti.i32):
    """Return the weights around a pixel, and the values there times those."""
    right = weights[0, v, u]
    below = weights[1, v, u]
    total = right + below
    value = 0.0
    if right > 0.0:
        value += right * x[v, u + 1]
    if below > 0.0:
        value += below * x[v + 1, u]
    if u > 0:
        left = weights[0, v, u - 1]
        total += left
        if left > 0.0:
            value += left * x[v, u - 1]
    if v > 0:
        above = weights[1, v - 1, u]
        total += above
        if above > 0.0:
            value += above * x[v - 1, u]
    return ti.math.vec2(total, value)


@ti.func
def _solve(weights: ti.template(), b: ti.template(), v: ti.i32, u: ti.i32, x: ti.template()):
    """Solve the equation of a pixel for its own value."""
    around = _neighbours(weights, x, v, u)
    if around[0] > 0.0:
        x[v, u] = (b[v, u] + around[1]) / around[0]


@ti.kernel
def _smooth(weights: f32_3, b: f32_2, color: ti.i32, x: f32_2):
    for v, half in ti.ndrange(x.shape[0], (x.shape[1] + 1) // 2):
        u = 2 * half + (v + color) % 2
        if u < x.shape[1]:
            _solve(weights, b, v, u, x)


@primitive
def smooth(weights: np.ndarray, b: np.ndarray, color: int, x: np.ndarray) -> None:
    """Solve each equation of the pixels of a colour, as of a chess board, for its own value."""
    _smooth(weights, b, color, x)


@ti.kernel
def _restrict(weights: f32_3, b: f32_2, x: f32_2, coarse: f32_2):
    for n, m in coarse:
        total = 0.0
        for k in range(2):
            v = 2 * n + k
            u = 2 * m + k
            if v < x.shape[0] and u < x.shape[1]:
                around = _neighbours(weights, x, v, u)
                total += b[v, u] - (around[0] * x[v, u] - around[1])
        coarse[n, m] = total


@primitive
def restrict(weights: np.ndarray, b: np.ndarray, x: np.ndarray, coarse: np.ndarray) -> None:
    """Write the residual of each block of 2 x 2 pixels, after colour 1 was smoothed last.

    The residual of pixels of this colour is 0.
    """
    _restrict(weights, b, x, coarse)


@ti.kernel
def _prolong(coarse: f32_2, x: f32_2):
    for v, u in x:
        x[v, u] += coarse[v // 2, u // 2]


@primitive
def prolong(coarse: np.ndarray, x: np.ndarray) -> None:
    """Add to each pixel the value of its block."""
    _prolong(coarse, x)


@ti.kernel
def _settle(weights: f32_3, b: f32_2, sweeps: ti.i32, x: f32_2):
    for _ in range(1):  # one thread
        size = x.shape[0] * x.shape[1]
        for i in range(size):
            x[i // x.shape[1], i % x.shape[1]] = 0.0
        for sweep in range(2 * sweeps):
            for i in range(size):
                j = i
                if sweep % 2 == 1:
                    j = size - 1 - i
                _solve(weights, b, j // x.shape[1], j % x.shape[1], x)


@primitive
def settle(weights: np.ndarray, b: np.ndarray, sweeps: int, x: np.ndarray) -> None:
    """Solve the equations of the coarsest level by sweeps there and back, on one thread."""
    _settle(weights, b, sweeps, x)


@ti.func
def _part(a: ti.template(), b: ti.template(), i: ti.i32) -> ti.f64:
    """Return part i of the sum of a b."""
    size = a.shape[0] * a.shape[1]
    share = (size + CHUNKS - 1) // CHUNKS
    total = ti.cast(0.0, ti.f64)
    for k in range(i * share, ti.min((i + 1) * share, size)):
        y = k // a.shape[1]
        x = k % a.shape[1]
        total += a[y, x] * ti.cast(b[y, x], ti.f64)
    return total


@ti.kernel
def _weigh_rest(r: f64_2, s: f32_2, partial: f64_1):
    for i in range(CHUNKS):
        partial[i] = _part(r, s, i)


@ti.kernel
def _weigh_step(p: f64_2, q: f64_2, partial: f64_1):
    for i in range(CHUNKS):
        partial[i] = _part(p, q, i)


@ti.kernel
def _add_parts(partial: f64_1, slot: ti.i32, sums: f64_1):
    for _ in range(1):  # one thread
        total = ti.cast(0.0, ti.f64)
        for i in range(partial.shape[0]):
            total += partial[i]
        if slot == 0:
            sums[2] = sums[0]
        sums[slot] = total


@primitive
def weigh_rest(r: np.ndarray, s: np.ndarray, partial: np.ndarray, sums: np.ndarray) -> None:
    """Write the sum of r s into sums[0]; sums[2] keeps the one before."""
    _weigh_rest(r, s, partial)
    _add_parts(partial, 0, sums)


@primitive
def weigh_step(p: np.ndarray, q: np.ndarray, partial: np.ndarray, sums: np.ndarray) -> None:
    """Write the sum of p q into sums[1]."""
    _weigh_step(p, q, partial)
    _add_parts(partial, 1, sums)


@ti.kernel
def _advance(p: f64_2, q: f64_2, sums: f64_1, z: f64_2, r: f64_2):
    for y, x in z:
        a = ti.cast(0.0, ti.f64)
        if sums[1] > 0.0:
            a = sums[0] / sums[1]
        z[y, x] += a * p[y, x]
        r[y, x] -= a * q[y, x]


@primitive
def advance(p: np.ndarray, q: np.ndarray, sums: np.ndarray, z: np.ndarray, r: np.ndarray) -> None:
    """Go along a direction to the least energy: z += a p, r -= a q, with a of the sums."""
    _advance(p, q, sums, z, r)


@ti.kernel
def _turn(s: f32_2, sums: f64_1, p: f64_2):
    for y, x in p:
        before = ti.cast(0.0, ti.f64)
        if sums[2] > 0.0:
            before = sums[0] / sums[2] * p[y, x]
        p[y, x] = ti.cast(s[y, x], ti.f64) + before


@primitive
def turn(s: np.ndarray, sums: np.ndarray, p: np.ndarray) -> None:
    """Turn the direction: p = s + b p, with b of the sums, 0 at the beginning."""
    _turn(s, sums, p)


@ti.kernel
def _begin(r: f64_2, b: f32_2, x: f32_2):
    for v, u in r:
        b[v, u] = ti.cast(r[v, u], ti.f32)
        x[v, u] = 0.0


@primitive
def begin(r: np.ndarray, b: np.ndarray, x: np.ndarray) -> None:
    """Write the right side of the finest level in float32, and 0 for its solution."""
    _begin(r, b, x)
