"""Conjugate gradients, and a multigrid cycle that preconditions them, in Warp.

The Taichi set has the equations. One thread has a pixel, on the CPU in slabs.
"""

import warp as wp

from cvkern.kernels.codes.shading import CHUNKS
from cvkern.kernels.warp._launch import launch, launch_each

OPTIONS = {"enable_backward": False, "fuse_fp": False}
wp.set_module_options(OPTIONS)


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
    size = coarse_inside.size
    launch_each(_coarsen, size, 32 * size, [weights, inside], [coarse, coarse_inside])


@wp.kernel
def _coarsen(
    stride: int,
    first: int,
    last: int,
    weights: wp.array3d[float],
    inside: wp.array2d[wp.uint8],
    # outputs
    coarse: wp.array3d[float],
    coarse_inside: wp.array2d[wp.uint8],
):
    for i in range(first + wp.tid(), last, stride):
        y = i // coarse_inside.shape[1]
        x = i % coarse_inside.shape[1]
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


def smooth(weights: wp.array, b: wp.array, color: int, x: wp.array) -> None:
    """Solve each equation of the pixels of a colour, as of a chess board, for its own value."""
    count = x.shape[0] * ((x.shape[1] + 1) // 2)
    launch_each(_smooth, count, 8 * x.size, [weights, b, color], [x])


@wp.kernel
def _smooth(
    stride: int,
    first: int,
    last: int,
    weights: wp.array3d[float],
    b: wp.array2d[float],
    color: int,
    # outputs
    x: wp.array2d[float],
):
    half = (x.shape[1] + 1) // 2
    for i in range(first + wp.tid(), last, stride):
        v = i // half
        u = 2 * (i % half) + (v + color) % 2
        if u < x.shape[1]:
            around = _neighbours(weights, x, v, u)
            if around[0] > 0.0:
                x[v, u] = (b[v, u] + around[1]) / around[0]


def restrict(weights: wp.array, b: wp.array, x: wp.array, coarse: wp.array) -> None:
    """Write what is left of the equations of each block of 2 x 2 pixels."""
    launch_each(_restrict, coarse.size, 16 * x.size, [weights, b, x], [coarse])


@wp.kernel
def _restrict(
    stride: int,
    first: int,
    last: int,
    weights: wp.array3d[float],
    b: wp.array2d[float],
    x: wp.array2d[float],
    # outputs
    coarse: wp.array2d[float],
):
    for i in range(first + wp.tid(), last, stride):
        v = 2 * (i // coarse.shape[1])
        u = 2 * (i % coarse.shape[1])
        total = float(0.0)
        for k in range(2):
            for j in range(2):
                if v + k < x.shape[0] and u + j < x.shape[1]:
                    around = _neighbours(weights, x, v + k, u + j)
                    total += b[v + k, u + j] - (around[0] * x[v + k, u + j] - around[1])
        coarse[i // coarse.shape[1], i % coarse.shape[1]] = total


def prolong(coarse: wp.array, x: wp.array) -> None:
    """Add to each pixel the value of its block."""
    launch_each(_prolong, x.size, x.size, [coarse], [x])


@wp.kernel
def _prolong(
    stride: int,
    first: int,
    last: int,
    coarse: wp.array2d[float],
    # outputs
    x: wp.array2d[float],
):
    for i in range(first + wp.tid(), last, stride):
        v = i // x.shape[1]
        u = i % x.shape[1]
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
            v = j // x.shape[1]
            u = j % x.shape[1]
            around = _neighbours(weights, x, v, u)
            if around[0] > 0.0:
                x[v, u] = (b[v, u] + around[1]) / around[0]


def weigh_rest(r: wp.array, s: wp.array, partial: wp.array, sums: wp.array) -> None:
    """Write the sum of r s; the one before moves on by two places."""
    across = int(r.device.is_cuda)
    launch_each(_rest_parts, CHUNKS, r.size, [r, s, across], [partial])
    launch(_add_parts, 1, [partial, 0], [sums])


@wp.func
def _place(i: int, j: int, chunks: int, share: int, across: int):
    """Return the j-th pixel of a part: one after the other, or on CUDA side by side."""
    return wp.where(across == 1, j * chunks + i, i * share + j)


@wp.kernel
def _rest_parts(
    stride: int,
    first: int,
    last: int,
    r: wp.array2d[wp.float64],
    s: wp.array2d[float],
    across: int,
    # outputs
    partial: wp.array[wp.float64],
):
    size = r.shape[0] * r.shape[1]
    share = (size + partial.shape[0] - 1) // partial.shape[0]
    for i in range(first + wp.tid(), last, stride):
        total = wp.float64(0.0)
        for j in range(share):
            k = _place(i, j, partial.shape[0], share, across)
            if k < size:
                y = k // r.shape[1]
                x = k % r.shape[1]
                total += r[y, x] * wp.float64(s[y, x])
        partial[i] = total


def weigh_step(p: wp.array, q: wp.array, partial: wp.array, sums: wp.array) -> None:
    """Write the sum of p q."""
    across = int(p.device.is_cuda)
    launch_each(_step_parts, CHUNKS, p.size, [p, q, across], [partial])
    launch(_add_parts, 1, [partial, 1], [sums])


@wp.kernel
def _step_parts(
    stride: int,
    first: int,
    last: int,
    p: wp.array2d[wp.float64],
    q: wp.array2d[wp.float64],
    across: int,
    # outputs
    partial: wp.array[wp.float64],
):
    size = p.shape[0] * p.shape[1]
    share = (size + partial.shape[0] - 1) // partial.shape[0]
    for i in range(first + wp.tid(), last, stride):
        total = wp.float64(0.0)
        for j in range(share):
            k = _place(i, j, partial.shape[0], share, across)
            if k < size:
                y = k // p.shape[1]
                x = k % p.shape[1]
                total += p[y, x] * q[y, x]
        partial[i] = total


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
    launch_each(_advance, z.size, 4 * z.size, [p, q, sums], [z, r])


@wp.kernel
def _advance(
    stride: int,
    first: int,
    last: int,
    p: wp.array2d[wp.float64],
    q: wp.array2d[wp.float64],
    sums: wp.array[wp.float64],  # r times its smoothed self, p times q, the first before
    # outputs
    z: wp.array2d[wp.float64],
    r: wp.array2d[wp.float64],
):
    a = wp.float64(0.0)
    if sums[1] > wp.float64(0.0):
        a = sums[0] / sums[1]
    for i in range(first + wp.tid(), last, stride):
        y = i // z.shape[1]
        x = i % z.shape[1]
        z[y, x] = z[y, x] + a * p[y, x]
        r[y, x] = r[y, x] - a * q[y, x]


def turn(s: wp.array, sums: wp.array, p: wp.array) -> None:
    """Turn the direction: p = s + b p, with b of the sums, 0 at the beginning."""
    launch_each(_turn, p.size, 2 * p.size, [s, sums], [p])


@wp.kernel
def _turn(
    stride: int,
    first: int,
    last: int,
    s: wp.array2d[float],
    sums: wp.array[wp.float64],
    # outputs
    p: wp.array2d[wp.float64],
):
    b = wp.float64(0.0)
    if sums[2] > wp.float64(0.0):
        b = sums[0] / sums[2]
    for i in range(first + wp.tid(), last, stride):
        y = i // p.shape[1]
        x = i % p.shape[1]
        before = wp.float64(0.0)
        if b > wp.float64(0.0):
            before = b * p[y, x]
        p[y, x] = wp.float64(s[y, x]) + before


def begin(r: wp.array, b: wp.array, x: wp.array) -> None:
    """Write the right side of the finest level in float32, and 0 for its solution."""
    launch_each(_begin, r.size, 2 * r.size, [r], [b, x])


@wp.kernel
def _begin(
    stride: int,
    first: int,
    last: int,
    r: wp.array2d[wp.float64],
    # outputs
    b: wp.array2d[float],
    x: wp.array2d[float],
):
    for i in range(first + wp.tid(), last, stride):
        v = i // r.shape[1]
        u = i % r.shape[1]
        b[v, u] = float(r[v, u])
        x[v, u] = 0.0
