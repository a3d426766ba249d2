"""Equations of the edges between pixels, from normals, in Taichi.

An edge joins a pixel a to the pixel b at its right or below. The depth z has the least sum over all
edges of ``w_a (z_b - z_a - s_a)^2 + w_b (z_b - z_a - s_b)^2``, where normals give the slopes
``s = n_x / n_z`` along the rows and ``-n_y / n_z`` down the columns. Poisson's weights are 1/2.
Bilateral ones are ``n_z^2`` times the share of a side, ``1 / (1 + exp(-k (d_-^2 - d_+^2)))`` for
the side after a pixel, where ``d = n_z`` times the difference to either neighbour [Cao 2022].

The mean of two slopes is not the rise between them where the slope itself curves. `adjust` takes
that out: from five slopes in a row it makes ``(8 s_0 + 3 (s_-1 + s_1) - (s_-2 + s_2)) / 12``. The
mean of two such values is the rise of a surface of degree 4, and contains no more noise than that
of two slopes. Of fewer slopes it makes ``s - s'' / 12``, at an end with the ``s''`` of the
neighbour.

An edge has the weight ``w = w_a + w_b`` and pulls with ``w (z_b - z_a) - (w_a s_a + w_b s_b)``;
equations are solved where the pulls on each pixel add up to 0.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi.shading._mask import is_inside

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
f64_1 = ti.types.ndarray(dtype=ti.f64, ndim=1)
f64_2 = ti.types.ndarray(dtype=ti.f64, ndim=2)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)


@ti.kernel
def _slopes(normals: f32_3, mask: u8_2, flattest: ti.f32, inside: u8_2, slope: f32_3, cut: i32_1):
    for y, x in inside:
        nx = normals[y, x, 0]
        ny = normals[y, x, 1]
        nz = normals[y, x, 2]
        length = ti.sqrt(nx * nx + ny * ny + nz * nz)
        found = is_inside(mask, y, x) and length < ti.math.inf and nz > 0.0
        inside[y, x] = ti.cast(found, ti.u8)
        a = 0.0
        b = 0.0
        c = 0.0
        if found:
            c = ti.max(nz / length, flattest)
            a = nx / length / c
            b = (0.0 - ny) / length / c
        else:
            cut[0] = 1
        slope[0, y, x] = a
        slope[1, y, x] = b
        slope[2, y, x] = c


@primitive
def slopes(
    normals: np.ndarray,
    mask: np.ndarray,
    flattest: float,
    inside: np.ndarray,
    slope: np.ndarray,
    cut: np.ndarray,
) -> None:
    """Write where normals face the camera, and there their slopes of depth and their z.

    `cut` (1,) becomes 1 if there is a pixel outside, and stays as it is otherwise.
    """
    _slopes(normals, mask, flattest, inside, slope, cut)


@ti.func
def _there(inside: ti.template(), y: ti.i32, x: ti.i32) -> bool:
    found = False
    if 0 <= y < inside.shape[0] and 0 <= x < inside.shape[1]:
        found = inside[y, x] != 0
    return found


@ti.func
def _bend(slope: ti.template(), axis: ti.i32, y: ti.i32, x: ti.i32, k: ti.i32) -> ti.f32:
    """Return the second difference of slopes k pixels apart."""
    own = slope[axis, y, x]
    before = slope[axis, y - axis * k, x - (1 - axis) * k]
    after = slope[axis, y + axis * k, x + (1 - axis) * k]
    return (before - own) + (after - own)


@ti.kernel
def _adjust(inside: u8_2, slope: f32_3, adjusted: f32_3):
    for y, x in inside:
        for axis in ti.static(range(2)):
            v, u = axis, 1 - axis
            here = inside[y, x] != 0
            before = here and _there(inside, y - v, x - u)
            after = here and _there(inside, y + v, x + u)
            more_before = before and _there(inside, y - 2 * v, x - 2 * u)
            more_after = after and _there(inside, y + 2 * v, x + 2 * u)
            curve = 0.0
            if more_before and more_after:
                curve = _bend(slope, axis, y, x, 2) - 3.0 * _bend(slope, axis, y, x, 1)
            elif before and after:
                curve = _bend(slope, axis, y, x, 1)
            elif more_before:
                curve = _bend(slope, axis, y - v, x - u, 1)
            elif more_after:
                curve = _bend(slope, axis, y + v, x + u, 1)
            adjusted[axis, y, x] = slope[axis, y, x] - curve / 12.0


@primitive
def adjust(inside: np.ndarray, slope: np.ndarray, adjusted: np.ndarray) -> None:
    """Write slopes such that the mean of two neighbours is the rise between them."""
    _adjust(inside, slope, adjusted)


@ti.func
def _difference(
    depth: ti.template(), inside: ti.template(), y: ti.i32, x: ti.i32, v: ti.i32, u: ti.i32
) -> ti.f64:
    """Return the depth at (v, u) less that at (y, x), 0 where one of them is outside."""
    found = ti.cast(0.0, ti.f64)
    if 0 <= v < inside.shape[0] and 0 <= u < inside.shape[1]:
        if inside[y, x] != 0 and inside[v, u] != 0:
            found = depth[v, u] - depth[y, x]
    return found


@ti.func
def _side(before: ti.f64, after: ti.f64, z: ti.f32, sharpness: ti.f32) -> ti.f32:
    """Return the share of the difference to the pixel after: more, the smaller it is."""
    a = ti.cast(z, ti.f64) * before
    b = ti.cast(z, ti.f64) * after
    e = ti.math.clamp(ti.cast(sharpness, ti.f64) * (a * a - b * b), -30.0, 30.0)
    return ti.cast(1.0 / (1.0 + ti.exp(-e)), ti.f32)


@ti.kernel
def _sides(depth: f64_2, inside: u8_2, slope: f32_3, sharpness: ti.f32, shares: f32_3):
    for y, x in inside:
        z = slope[2, y, x]
        left = _difference(depth, inside, y, x, y, x - 1)
        right = _difference(depth, inside, y, x, y, x + 1)
        above = _difference(depth, inside, y, x, y - 1, x)
        below = _difference(depth, inside, y, x, y + 1, x)
        shares[0, y, x] = _side(left, right, z, sharpness)
        shares[1, y, x] = _side(above, below, z, sharpness)


@primitive
def sides(
    depth: np.ndarray, inside: np.ndarray, slope: np.ndarray, sharpness: float, shares: np.ndarray
) -> None:
    """Write on which side of a pixel its surface goes on: right, and below."""
    _sides(depth, inside, slope, sharpness, shares)


@ti.kernel
def _join(inside: u8_2, slope: f32_3, shares: f32_3, weights: f32_3, rises: f32_3):
    for y, x in inside:
        for axis in ti.static(range(2)):
            v = y + axis
            u = x + 1 - axis
            weight = 0.0
            rise = 0.0
            if v < inside.shape[0] and u < inside.shape[1]:
                if inside[y, x] != 0 and inside[v, u] != 0:
                    a = 0.5
                    b = 0.5
                    if shares.shape[0] > 0:
                        a = shares[axis, y, x] * slope[2, y, x] * slope[2, y, x]
                        b = (1.0 - shares[axis, v, u]) * slope[2, v, u] * slope[2, v, u]
                    weight = a + b
                    rise = a * slope[axis, y, x] + b * slope[axis, v, u]
            weights[axis, y, x] = weight
            rises[axis, y, x] = rise


@primitive
def join(
    inside: np.ndarray,
    slope: np.ndarray,
    shares: np.ndarray,
    weights: np.ndarray,
    rises: np.ndarray,
) -> None:
    """Write the weight and the weighted rise of the edge to the right and of that below.

    Without shares, of shape (0, 1, 1), all weights are 1.
    """
    _join(inside, slope, shares, weights, rises)


@ti.func
def _edge(
    weights: ti.template(), rises: ti.template(), z: ti.template(),
    axis: ti.i32, y: ti.i32, x: ti.i32,
) -> ti.f64:  # fmt: skip
    """Return the pull of an edge: its weight times the error of the rise of z."""
    weight = weights[axis, y, x]
    pull = ti.cast(0.0, ti.f64)
    if weight > 0.0:
        rise = z[y + axis, x + 1 - axis] - z[y, x]
        pull = ti.cast(weight, ti.f64) * rise
        if rises.shape[0] > 0:
            pull -= ti.cast(rises[axis, y, x], ti.f64)
    return pull


@ti.kernel
def _pull(weights: f32_3, rises: f32_3, z: f64_2, sign: ti.f32, out: f64_2):
    for y, x in z:
        total = _edge(weights, rises, z, 0, y, x) + _edge(weights, rises, z, 1, y, x)
        if x > 0:
            total -= _edge(weights, rises, z, 0, y, x - 1)
        if y > 0:
            total -= _edge(weights, rises, z, 1, y - 1, x)
        out[y, x] = ti.cast(sign, ti.f64) * total


@primitive
def pull(
    weights: np.ndarray, rises: np.ndarray, z: np.ndarray, sign: float, out: np.ndarray
) -> None:
    """Write the sum of the pulls of the edges of each pixel, times a sign.

    With the rises and sign 1 that is what is left of the equations; without, of shape (0, 1, 1),
    and sign -1, the product of their matrix and z.
    """
    _pull(weights, rises, z, sign, out)


@ti.kernel
def _weigh_misfit(depth: f64_2, inside: u8_2, slope: f32_3, shares: f32_3, rows: f64_1):
    for y in rows:
        total = ti.cast(0.0, ti.f64)
        for x in range(inside.shape[1]):
            for axis in ti.static(range(2)):
                v = y + axis
                u = x + 1 - axis
                if v < inside.shape[0] and u < inside.shape[1]:
                    if inside[y, x] != 0 and inside[v, u] != 0:
                        rise = depth[v, u] - depth[y, x]
                        a = rise - ti.cast(slope[axis, y, x], ti.f64)
                        b = rise - ti.cast(slope[axis, v, u], ti.f64)
                        za = ti.cast(slope[2, y, x], ti.f64)
                        zb = ti.cast(slope[2, v, u], ti.f64)
                        total += ti.cast(shares[axis, y, x], ti.f64) * za * za * a * a
                        total += ti.cast(1.0 - shares[axis, v, u], ti.f64) * zb * zb * b * b
        rows[y] = total


@primitive
def weigh_misfit(
    depth: np.ndarray,
    inside: np.ndarray,
    slope: np.ndarray,
    shares: np.ndarray,
    rows: np.ndarray,
) -> None:
    """Write the energy of each row: the weighted squares of the residuals of equations."""
    _weigh_misfit(depth, inside, slope, shares, rows)


@ti.kernel
def _finish(z: f64_2, parts: i32_2, means: f64_1, depth: f32_2):
    for y, x in z:
        depth[y, x] = ti.cast(ti.math.nan, ti.f32)
        if parts[y, x] > 0:
            depth[y, x] = ti.cast(z[y, x] - means[parts[y, x]], ti.f32)


@primitive
def finish(z: np.ndarray, parts: np.ndarray, means: np.ndarray, depth: np.ndarray) -> None:
    """Write depth in float32, less the mean of each part, NaN in part 0."""
    _finish(z, parts, means, depth)
