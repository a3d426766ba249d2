"""Splats on the screen and the gradients by them, in Taichi; one thread per splat.

A splat of mean m, standard deviations s along axes turned by R, has the covariance
Sigma = R diag(s)^2 R^T. With the camera's axes as the rows of W and (x, y) = (X, Y) / Z for
(X, Y, Z) = W (m - o), the lens shows it at (column, row) = f bend(x, y) + c, and

    J = diag(f) D (1 / Z) [1 0 -x; 0 1 -y] W,  Sigma' = J Sigma J^T + blur I,

with the slopes D of the bend: EWA splatting [Zwicker et al. 2001] as in 3DGS [Kerbl et al. 2023].
In J, x and y are moved to at most 0.15 of the picture's width or height beside it. With
[u; v] = J R diag(s), Sigma' = [<u, u> <u, v>; <u, v> <v, v>] + blur I. The opacity falls off as
o exp(-d^T Q d / 2), Q = Sigma'^-1, so it is above 1 / 255 within the ellipse d^T Q d < 2 ln 255 o,
whose box reaches sqrt(2 ln(255 o) Sigma'_xx) to the sides. The colour is 1/2 + sum_k h_k c_k with
the harmonics h of the direction from the camera, and at least 0.

Backward, for the symmetric gradient G by Q, that by Sigma' is -Q G Q, with entries a b; b c, so
dL/du = 2 (a u + b v) and dL/dv = 2 (b u + c v); the rest is the chain rule. The slopes D of the
bend are taken as constant. The gradients of a splat's entries are added in their order.

Sums are written out, term by term, so that both sets round alike on the CPU.
"""

from typing import Any

import numpy as np
import taichi as ti

from cvkern.kernels.codes import splats as codes
from cvkern.kernels.codes.splats import CULLED, FAINT, SLOPES, TILE
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi.radiance._harmonics import harmonics, vec16

from ._placing import Extent, arm_of, axis_of, dot, mat3, placed, vec3

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
slopes_type = ti.types.vector(SLOPES, ti.f32)

SLACK = 0.01  # pixels that roundings may take from the reach of a splat


@ti.func
def _color_of(
    colors: ti.template(), sides: ti.template(), n: ti.i32, h: vec16, channel: ti.i32
) -> ti.f32:
    """Return a channel, before negative ones become 0."""
    total = 0.5 + h[0] * colors[n, channel]
    for k in ti.static(range(15)):
        if 3 * k + 2 < sides.shape[1]:
            total += h[k + 1] * sides[n, 3 * k + channel]
    return total


@ti.kernel
def _project(
    means: f32_2,  # (N, 3)
    turns: f32_2,  # (N, 4)
    scales: f32_2,  # (N, 3)
    opacities: f32_2,  # (N, 1)
    colors: f32_2,  # (N, 3)
    sides: f32_2,  # (N, 3 (K - 1)), or (1, 1)
    poses: f32_3,  # (V, 3, 4)
    lenses: f32_2,  # (V, 9)
    number: i32_1,  # (1,)
    extent: Extent,
    # outputs
    shown: f32_2,  # (N, 12)
    boxes: i32_2,  # (N, 4)
    keys: i32_1,  # (N,)
):
    for n in range(keys.shape[0]):
        view = number[0]
        p = placed(means, turns, scales, opacities, poses, lenses, view, extent, n)
        columns, rows, left, top = 0, 0, 0, 0
        if p.seen == 1:
            determinant = p.a * p.c - p.b * p.b
            reach = 2.0 * ti.log(p.opacity / FAINT)
            aside = ti.sqrt(reach * p.a) + SLACK
            above = ti.sqrt(reach * p.c) + SLACK
            width = ti.cast(extent.width - 1, ti.f32)
            height = ti.cast(extent.height - 1, ti.f32)
            if (
                p.column + aside >= 0.0
                and p.column - aside <= width
                and p.row + above >= 0.0
                and p.row - above <= height
            ):
                left = ti.cast(ti.max(p.column - aside, 0.0), ti.i32) // TILE
                top = ti.cast(ti.max(p.row - above, 0.0), ti.i32) // TILE
                columns = ti.cast(ti.min(p.column + aside, width), ti.i32) // TILE + 1 - left
                rows = ti.cast(ti.min(p.row + above, height), ti.i32) // TILE + 1 - top
                arm = arm_of(means, poses, view, n)
                distance = ti.sqrt(dot(arm, arm))
                h = harmonics(arm[0] / distance, arm[1] / distance, arm[2] / distance)
                shown[n, 0] = p.column
                shown[n, 1] = p.row
                shown[n, 2] = p.c / determinant
                shown[n, 3] = -p.b / determinant
                shown[n, 4] = p.a / determinant
                shown[n, 5] = p.opacity
                for channel in range(3):
                    shown[n, 6 + channel] = ti.max(_color_of(colors, sides, n, h, channel), 0.0)
                shown[n, 9] = distance
                shown[n, 10] = aside
                shown[n, 11] = above
        boxes[n, 0] = left
        boxes[n, 1] = top
        boxes[n, 2] = columns
        boxes[n, 3] = rows
        keys[n] = CULLED
        if columns > 0:
            keys[n] = ti.bit_cast(p.depth, ti.i32)


@primitive
def project(splats: codes.Splats, sight: codes.Sight, screen: codes.Screen) -> None:
    """Find where splats are on the screen, and their colours; those not seen have no box."""
    _project(*splats, *sight[:3], _extent(sight), *screen)


def _extent(sight: codes.Sight) -> Any:
    return Extent(width=sight.width, height=sight.height, near=sight.near, blur=sight.blur)


@ti.func
def _slope_of(x: ti.f32, y: ti.f32, z: ti.f32, w: vec16) -> vec3:
    """Return the slope of the sum of harmonics times `w`, by a direction."""
    c1, c2, c3 = ti.static(0.4886025119029199, 1.0925484305920792, 0.5900435899266435)
    c4, c5, c6 = ti.static(0.4570457994644658, 2.890611442640554, 1.445305721320277)
    dx = -c1 * w[3] + c2 * (y * w[4] - z * w[7]) + c2 * x * w[8]
    dx += -c3 * (6.0 * x * y * w[9] + (3.0 * x * x - 3.0 * y * y) * w[15])
    dx += c5 * y * z * w[10] - c4 * (5.0 * z * z - 1.0) * w[13] + 2.0 * c6 * x * z * w[14]
    dy = -c1 * w[1] + c2 * (x * w[4] - z * w[5]) - c2 * y * w[8]
    dy += -c3 * ((3.0 * x * x - 3.0 * y * y) * w[9] - 6.0 * x * y * w[15])
    dy += c5 * x * z * w[10] - c4 * (5.0 * z * z - 1.0) * w[11] - 2.0 * c6 * y * z * w[14]
    dz = c1 * w[2] - c2 * (y * w[5] + x * w[7]) + 1.8923493915151202 * z * w[6]
    dz += c5 * x * y * w[10] - 4.570457994644658 * z * (y * w[11] + x * w[13])
    dz += 0.3731763325901154 * (15.0 * z * z - 3.0) * w[12] + c6 * (x * x - y * y) * w[14]
    return vec3(dx, dy, dz)


@ti.func
def _add_colors(
    colors: ti.template(), sides: ti.template(), n: ti.i32, arm: vec3, g: vec3,
    d_colors: ti.template(), d_sides: ti.template(),
) -> vec3:  # fmt: skip
    """Add the gradients by coefficients; return that by the splat's position."""
    distance = ti.sqrt(dot(arm, arm))
    x, y, z = arm[0] / distance, arm[1] / distance, arm[2] / distance
    h = harmonics(x, y, z)
    gains = vec3(0.0)
    for channel in ti.static(range(3)):
        if _color_of(colors, sides, n, h, channel) > 0.0:
            gains[channel] = g[channel]
    w = vec16(0.0)
    for channel in ti.static(range(3)):
        d_colors[n, channel] = d_colors[n, channel] + h[0] * gains[channel]
    for k in ti.static(range(15)):
        if 3 * k + 2 < sides.shape[1]:
            for channel in ti.static(range(3)):
                at = 3 * k + channel
                w[k + 1] += gains[channel] * sides[n, at]
                d_sides[n, at] = d_sides[n, at] + h[k + 1] * gains[channel]
    s = _slope_of(x, y, z, w)
    along = s[0] * x + s[1] * y + s[2] * z
    return vec3(
        (s[0] - along * x) / distance, (s[1] - along * y) / distance, (s[2] - along * z) / distance
    )


@ti.func
def _add_turn(length: ti.f32, turns: ti.template(), n: ti.i32, d: mat3, d_turns: ti.template()):
    """Add the gradient by a quaternion, given that by its rotation."""
    w, x = turns[n, 0] / length, turns[n, 1] / length
    y, z = turns[n, 2] / length, turns[n, 3] / length
    gw = z * (d[1, 0] - d[0, 1]) + y * (d[0, 2] - d[2, 0]) + x * (d[2, 1] - d[1, 2])
    gx = y * (d[0, 1] + d[1, 0]) + z * (d[0, 2] + d[2, 0]) + w * (d[2, 1] - d[1, 2])
    gx = gx - 2.0 * x * (d[1, 1] + d[2, 2])
    gy = x * (d[0, 1] + d[1, 0]) + z * (d[1, 2] + d[2, 1]) + w * (d[0, 2] - d[2, 0])
    gy = gy - 2.0 * y * (d[0, 0] + d[2, 2])
    gz = x * (d[0, 2] + d[2, 0]) + y * (d[1, 2] + d[2, 1]) + w * (d[1, 0] - d[0, 1])
    gz = gz - 2.0 * z * (d[0, 0] + d[1, 1])
    along = gw * w + gx * x + gy * y + gz * z
    factor = 2.0 / length
    d_turns[n, 0] = d_turns[n, 0] + factor * (gw - along * w)
    d_turns[n, 1] = d_turns[n, 1] + factor * (gx - along * x)
    d_turns[n, 2] = d_turns[n, 2] + factor * (gy - along * y)
    d_turns[n, 3] = d_turns[n, 3] + factor * (gz - along * z)


@ti.kernel
def _project_backward(
    means: f32_2,  # (N, 3)
    turns: f32_2,  # (N, 4)
    scales: f32_2,  # (N, 3)
    opacities: f32_2,  # (N, 1)
    colors: f32_2,  # (N, 3)
    sides: f32_2,  # (N, 3 (K - 1)), or (1, 1)
    poses: f32_3,  # (V, 3, 4)
    lenses: f32_2,  # (V, 9)
    number: i32_1,  # (1,)
    extent: Extent,
    ranks: i32_1,  # (N,)
    ends: i32_1,  # (N,)
    slopes: f32_2,  # (E, 9): gradients by a splat on the screen, entry by entry
    # outputs
    d_means: f32_2,  # (N, 3)
    d_turns: f32_2,  # (N, 4)
    d_scales: f32_2,  # (N, 3)
    d_opacities: f32_2,  # (N, 1)
    d_colors: f32_2,  # (N, 3)
    d_sides: f32_2,  # (N, 3 (K - 1)), or (1, 1)
):
    for n in range(ranks.shape[0]):
        rank = ranks[n]
        begin = 0
        if rank > 0:
            begin = ends[rank - 1]
        end = ti.min(ends[rank], slopes.shape[0])
        if 0 <= begin < end:
            s = slopes_type(0.0)
            for entry in range(begin, end):
                for k in ti.static(range(SLOPES)):
                    s[k] += slopes[entry, k]
            view = number[0]
            p = placed(means, turns, scales, opacities, poses, lenses, view, extent, n)
            arm = arm_of(means, poses, view, n)
            gains = vec3(s[6], s[7], s[8])
            moved = _add_colors(colors, sides, n, arm, gains, d_colors, d_sides)
            d_opacities[n, 0] = d_opacities[n, 0] + s[5] * p.opacity * (1.0 - p.opacity)
            determinant = p.a * p.c - p.b * p.b
            qa, qb, qc = p.c / determinant, -p.b / determinant, p.a / determinant
            half = 0.5 * s[3]
            m00 = qa * s[2] + qb * half
            m01 = qa * half + qb * s[4]
            m10 = qb * s[2] + qc * half
            m11 = qb * half + qc * s[4]
            da = -2.0 * (m00 * qa + m01 * qb)
            db = -2.0 * (m00 * qb + m01 * qc)
            dc = -2.0 * (m10 * qb + m11 * qc)
            du = da * p.u + db * p.v
            dv = dc * p.v + db * p.u
            d_turn = mat3(0.0)
            d_across, d_along = vec3(0.0), vec3(0.0)
            for m in ti.static(range(3)):
                d_size = 0.0
                for j in ti.static(range(3)):
                    slope = p.across[j] * du[m] + p.along[j] * dv[m]
                    d_size += slope * p.turn[j, m]
                    d_turn[j, m] = slope * p.size[m]
                    d_across[j] += p.turn[j, m] * p.size[m] * du[m]
                    d_along[j] += p.turn[j, m] * p.size[m] * dv[m]
                d_scales[n, m] = d_scales[n, m] + d_size * p.size[m]
            _add_turn(p.length, turns, n, d_turn, d_turns)
            right, down, ahead = (
                axis_of(poses, view, 0),
                axis_of(poses, view, 1),
                axis_of(poses, view, 2),
            )
            near = 1.0 / p.depth
            u2, v2 = dot(d_across, ahead), dot(d_along, ahead)
            d_near = dot(d_across, right) * p.d[0] + dot(d_across, down) * p.d[1]
            d_near += dot(d_along, right) * p.d[2] + dot(d_along, down) * p.d[3]
            d_near -= u2 * (p.d[0] * p.slope_x + p.d[1] * p.slope_y)
            d_near -= v2 * (p.d[2] * p.slope_x + p.d[3] * p.slope_y)
            dx = s[0] * p.d[0] + s[1] * p.d[2]
            dy = s[0] * p.d[1] + s[1] * p.d[3]
            if p.slope_x == p.x:
                dx -= (u2 * p.d[0] + v2 * p.d[2]) * near
            if p.slope_y == p.y:
                dy -= (u2 * p.d[1] + v2 * p.d[3]) * near
            # x = <right, arm> / depth, and so on.
            d_near += (dx * p.x + dy * p.y) * p.depth
            d_depth = -near * near * d_near
            for j in ti.static(range(3)):
                d_means[n, j] = d_means[n, j] + (
                    moved[j] + right[j] * (dx * near) + down[j] * (dy * near) + ahead[j] * d_depth
                )


@primitive
def project_backward(
    splats: codes.Splats,
    sight: codes.Sight,
    lists: codes.Lists,
    slopes: np.ndarray,
    d_splats: codes.Splats,
) -> None:
    """Add the gradients of splats, given those of their entries on the screen, (E, 9).

    The entries of a splat are added in their order.
    """
    extent = _extent(sight)
    _project_backward(*splats, *sight[:3], extent, lists.ranks, lists.ends, slopes, *d_splats)
