"""Conjugate gradients, and a multigrid cycle that preconditions them, in Warp.

The Taichi set has the equations. One thread has a pixel on CUDA, a row at a time on the CPU.
"""

from typing import Any

import warp as wp

from cvkern.kernels.codes.shading import CHUNKS
from cvkern.kernels.warp._launch import launch, launch_each, view
from cvkern.kernels.warp.shading._rows import launch_rows

OPTIONS = {"enable_backward": False, "fuse_fp": False}
wp.set_module_options(OPTIONS)


def _flat(array: wp.array) -> wp.array:
    return view(array, array.dtype, (array.size,))


@wp.func
def _series(weights: wp.array3d[float], inside: wp.array2d[wp.uint8], axis: int, y: int, x: int):
    """Return the weight of an edge between blocks: half of those within, in series with it.

    (y, x) is the pixel before the edge.
    """
    dv = axis
    du = 1 - axis
    weight = weights[axis, y, x]
    if weight > 0.0:
        resistance = 1.0 / weight
        if inside[y - dv, x - du] != wp.uint8(0):
            resistance += 0.5 / wp.max(weights[axis, y - dv, x - du], 0.01 * weight)
        v = y + 2 * dv
        u = x + 2 * du
        if v < inside.shape[0] and u < inside.shape[1]:
            if inside[v, u] != wp.uint8(0):
                resistance += 0.5 / wp.max(weights[axis, y + dv, x + du], 0.01 * weight)
        weight = 1.0 / resistance
    return weight


def coarsen(weights: wp.array, inside: wp.array, coarse: wp.array, coarse_inside: wp.array) -> None:
    """Write the edges of blocks of 2 x 2 pixels, and where there are such."""
    outputs = [coarse, coarse_inside]
    launch_rows(_coarsen, coarse_inside.shape, 32, [weights, inside], outputs)


@wp.kernel
def _coarsen(
    stride: int,
    first: int,
    last: int,
    run: int,
    weights: wp.array3d[float],
    inside: wp.array2d[wp.uint8],
    # outputs
    coarse: wp.array3d[float],
    coarse_inside: wp.array2d[wp.uint8],
):
    for i in range(first + wp.tid(), last, stride):
        y = i * run // coarse_inside.shape[1]
        begin = i * run % coarse_inside.shape[1]
        for x in range(begin, begin + run):
            count = int(0)
            right = float(0.0)
            below = float(0.0)
            for k in range(2):
                for j in range(2):
                    if 2 * y + k < inside.shape[0] and 2 * x + j < inside.shape[1]:
                        count += int(inside[2 * y + k, 2 * x + j])
                if 2 * x + 2 < inside.shape[1] and 2 * y + k < inside.shape[0]:
                    right += _series(weights, inside, 0, 2 * y + k, 2 * x + 1)
                if 2 * y + 2 < inside.shape[0] and 2 * x + k < inside.shape[1]:
                    below += _series(weights, inside, 1, 2 * y + 1, 2 * x + k)
            coarse[0, y, x] = right
            coarse[1, y, x] = below
            coarse_inside[y, x] = wp.where(count > 0, wp.uint8(1), wp.uint8(0))


@wp.func
def _neighbours(weights: wp.array3d[float], x: wp.array2d[float], v: int, u: int):
    """Return the weights around a pixel, and the values there times those."""
    right = weights[0, v, u]
    below = weights[1, v, u]
    total = right + below
    value = float(0.0)
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
    return wp.vec2(total, value)


@wp.func
def _solve(weights: wp.array3d[float], b: wp.array2d[float], v: int, u: int, x: wp.array2d[float]):
    """Solve the equation of a pixel for its own value."""
    around = _neighbours(weights, x, v, u)
    if around[0] > 0.0:
        x[v, u] = (b[v, u] + around[1]) / around[0]


def smooth(weights: wp.array, b: wp.array, color: int, x: wp.array) -> None:
    """Solve each equation of the pixels of a colour, as of a chess board, for its own value."""
    shape = x.shape[0], (x.shape[1] + 1) // 2
    launch_rows(_smooth, shape, 16, [weights, b, color], [x])


@wp.kernel
def _smooth(
    stride: int,
    first: int,
    last: int,
    run: int,
    weights: wp.array3d[float],
    b: wp.array2d[float],
    color: int,
    # outputs
    x: wp.array2d[float],
):
    half = (x.shape[1] + 1) // 2
    for i in range(first + wp.tid(), last, stride):
        v = i * run // half
        begin = 2 * (i * run % half) + (v + color) % 2
        for u in range(begin, wp.min(begin + 2 * run, x.shape[1]), 2):
            _solve(weights, b, v, u, x)


def restrict(weights: wp.array, b: wp.array, x: wp.array, coarse: wp.array) -> None:
    """Write the residual of each block of 2 x 2 pixels, after colour 1 was smoothed last.

    The residual of pixels of this colour is 0.
    """
    launch_rows(_restrict, coarse.shape, 32, [weights, b, x], [coarse])


@wp.kernel
def _restrict(
    stride: int,
    first: int,
    last: int,
    run: int,
    weights: wp.array3d[float],
    b: wp.array2d[float],
    x: wp.array2d[float],
    # outputs
    coarse: wp.array2d[float],
):
    for i in range(first + wp.tid(), last, stride):
        n = i * run // coarse.shape[1]
        begin = i * run % coarse.shape[1]
        for m in range(begin, begin + run):
            total = float(0.0)
            for k in range(2):
                v = 2 * n + k
                u = 2 * m + k
                if v < x.shape[0] and u < x.shape[1]:
                    around = _neighbours(weights, x, v, u)
                    total += b[v, u] - (around[0] * x[v, u] - around[1])
            coarse[n, m] = total


def prolong(coarse: wp.array, x: wp.array) -> None:
    """Add to each pixel the value of its block."""
    launch_rows(_prolong, x.shape, 1, [coarse], [x])


@wp.kernel
def _prolong(
    stride: int,
    first: int,
    last: int,
    run: int,
    coarse: wp.array2d[float],
    # outputs
    x: wp.array2d[float],
):
    for i in range(first + wp.tid(), last, stride):
        v = i * run // x.shape[1]
        begin = i * run % x.shape[1]
        for u in range(begin, begin + run):
            x[v, u] = x[v, u] + coarse[v // 2, u // 2]


def settle(weights: wp.array, b: wp.array, sweeps: int, x: wp.array) -> None:
    """Solve the equations of the coarsest level by sweeps there and back, on one thread."""
    launch(_settle, 1, [weights, b, sweeps], [x])


@wp.kernel
def _settle(
    weights: wp.array3d[float],
    b: wp.array2d[float],
    sweeps: int,
    # outputs
    x: wp.array2d[float],
):
    size = x.shape[0] * x.shape[1]
    for i in range(size):
        x[i // x.shape[1], i % x.shape[1]] = 0.0
    for sweep in range(2 * sweeps):
        for i in range(size):
            j = wp.where(sweep % 2 == 0, i, size - 1 - i)
            _solve(weights, b, j // x.shape[1], j % x.shape[1], x)


def weigh_rest(r: wp.array, s: wp.array, partial: wp.array, sums: wp.array) -> None:
    """Write the sum of r s into sums[0]; sums[2] keeps the one before."""
    _add(r, s, 0, partial, sums)


def weigh_step(p: wp.array, q: wp.array, partial: wp.array, sums: wp.array) -> None:
    """Write the sum of p q into sums[1]."""
    _add(p, q, 1, partial, sums)


def _add(a: wp.array, b: wp.array, slot: int, partial: wp.array, sums: wp.array) -> None:
    kernel = PARTS[b.dtype]
    across = int(a.device.is_cuda)
    launch_each(kernel, CHUNKS, a.size, [_flat(a), _flat(b), across], [partial])
    launch(_add_parts, 1, [partial, slot], [sums])


@wp.kernel
def _parts(
    stride: int,
    first: int,
    last: int,
    a: wp.array[wp.float64],
    b: wp.array[Any],
    across: int,  # whether the pixels of a part are apart, so that threads read side by side
    # outputs
    partial: wp.array[wp.float64],
):
    size = a.shape[0]
    share = (size + partial.shape[0] - 1) // partial.shape[0]
    for i in range(first + wp.tid(), last, stride):
        begin = i * share
        end = wp.min(begin + share, size)
        step = int(1)
        if across == 1:
            begin = i
            end = size
            step = partial.shape[0]
        total = wp.float64(0.0)
        for k in range(begin, end, step):
            total += a[k] * wp.float64(b[k])
        partial[i] = total


PARTS = {t: wp.overload(_parts, {"b": wp.array[t]}) for t in (wp.float32, wp.float64)}


@wp.kernel
def _add_parts(
    partial: wp.array[wp.float64],
    slot: int,
    # outputs
    sums: wp.array[wp.float64],
):
    total = wp.float64(0.0)
    for i in range(partial.shape[0]):
        total += partial[i]
    if slot == 0:
        sums[2] = sums[0]
    sums[slot] = total


def advance(p: wp.array, q: wp.array, sums: wp.array, z: wp.array, r: wp.array) -> None:
    """Go along a direction to the least energy: z += a p, r -= a q, with a of the sums."""
    inputs = [_flat(p), _flat(q), sums]
    launch_each(_advance, z.size, 4 * z.size, inputs, [_flat(z), _flat(r)])


@wp.kernel
def _advance(
    stride: int,
    first: int,
    last: int,
    p: wp.array[wp.float64],
    q: wp.array[wp.float64],
    sums: wp.array[wp.float64],  # r times its smoothed self, p times q, the first before
    # outputs
    z: wp.array[wp.float64],
    r: wp.array[wp.float64],
):
    a = wp.float64(0.0)
    if sums[1] > wp.float64(0.0):
        a = sums[0] / sums[1]
    for i in range(first + wp.tid(), last, stride):
        z[i] = z[i] + a * p[i]
        r[i] = r[i] - a * q[i]


def turn(s: wp.array, sums: wp.array, p: wp.array) -> None:
    """Turn the direction: p = s + b p, with b of the sums, 0 at the beginning."""
    launch_each(_turn, p.size, 2 * p.size, [_flat(s), sums], [_flat(p)])


@wp.kernel
def _turn(
    stride: int,
    first: int,
    last: int,
    s: wp.array[float],
    sums: wp.array[wp.float64],
    # outputs
    p: wp.array[wp.float64],
):
    if sums[2] > wp.float64(0.0):
        b = sums[0] / sums[2]
        for i in range(first + wp.tid(), last, stride):
            p[i] = wp.float64(s[i]) + b * p[i]
    else:
        for i in range(first + wp.tid(), last, stride):
            p[i] = wp.float64(s[i])


def begin(r: wp.array, b: wp.array, x: wp.array) -> None:
    """Write the right side of the finest level in float32, and 0 for its solution."""
    launch_each(_begin, r.size, 2 * r.size, [_flat(r)], [_flat(b), _flat(x)])


@wp.kernel
def _begin(
    stride: int,
    first: int,
    last: int,
    r: wp.array[wp.float64],
    # outputs
    b: wp.array[float],
    x: wp.array[float],
):
    for i in range(first + wp.tid(), last, stride):
        b[i] = float(r[i])
        x[i] = 0.0
