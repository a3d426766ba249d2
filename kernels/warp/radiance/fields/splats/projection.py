"""Splats on the screen and the gradients by them, in Warp; the Taichi set has the equations."""

import warp as wp

from cvkern.kernels.codes import splats as codes
from cvkern.kernels.warp._launch import launch_each
from cvkern.kernels.warp._structs import struct_of
from cvkern.kernels.warp.radiance._harmonics import harmonics, vec16

from ._placing import FAINT, Placed, arm_of, axis_of, dot, placed
from ._structs import Lists, Screen, Sight, Splats

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

TILE, CULLED = wp.constant(codes.TILE), wp.constant(codes.CULLED)
vec9 = wp.types.vector(length=codes.SLOPES, dtype=wp.float32)
SLACK = wp.constant(0.01)  # pixels that roundings may take from the reach of a splat


@wp.func
def color_of(splats: Splats, n: int, h: vec16, channel: int) -> float:
    """Return a channel, before negative ones become 0."""
    total = 0.5 + h[0] * splats.colors[n, channel]
    for k in range(splats.sides.shape[1] // 3):
        total += h[k + 1] * splats.sides[n, 3 * k + channel]
    return total


@wp.kernel
def project_kernel(
    stride: int,
    first: int,
    last: int,
    splats: Splats,
    sight: Sight,
    # outputs
    screen: Screen,
):
    """Find the place and the colour of a splat, and the tiles that it meets."""
    for n in range(first + wp.tid(), last, stride):
        p = placed(splats, sight, n)
        columns = int(0)
        rows = int(0)
        left = int(0)
        top = int(0)
        if p.seen:
            determinant = p.a * p.c - p.b * p.b
            reach = 2.0 * wp.log(p.opacity / FAINT)
            aside = wp.sqrt(reach * p.a) + SLACK
            above = wp.sqrt(reach * p.c) + SLACK
            width = float(sight.width - 1)
            height = float(sight.height - 1)
            if (
                p.column + aside >= 0.0
                and p.column - aside <= width
                and p.row + above >= 0.0
                and p.row - above <= height
            ):
                left = int(wp.max(p.column - aside, 0.0)) // TILE
                top = int(wp.max(p.row - above, 0.0)) // TILE
                columns = int(wp.min(p.column + aside, width)) // TILE + 1 - left
                rows = int(wp.min(p.row + above, height)) // TILE + 1 - top
                arm = arm_of(splats, sight, n)
                distance = wp.sqrt(dot(arm, arm))
                h = harmonics(arm[0] / distance, arm[1] / distance, arm[2] / distance)
                screen.shown[n, 0] = p.column
                screen.shown[n, 1] = p.row
                screen.shown[n, 2] = p.c / determinant
                screen.shown[n, 3] = -p.b / determinant
                screen.shown[n, 4] = p.a / determinant
                screen.shown[n, 5] = p.opacity
                for channel in range(3):
                    color = color_of(splats, n, h, channel)
                    screen.shown[n, 6 + channel] = wp.max(color, 0.0)
                screen.shown[n, 9] = distance
                screen.shown[n, 10] = aside
                screen.shown[n, 11] = above
        screen.boxes[n, 0] = left
        screen.boxes[n, 1] = top
        screen.boxes[n, 2] = columns
        screen.boxes[n, 3] = rows
        screen.keys[n] = wp.where(columns > 0, wp.cast(p.depth, int), CULLED)


def project(splats: codes.Splats, sight: codes.Sight, screen: codes.Screen) -> None:
    """Find where splats are on the screen, and their colours; those not seen have no box."""
    count = screen.keys.shape[0]
    inputs = [struct_of(Splats, splats), struct_of(Sight, sight)]
    launch_each(project_kernel, count, 64 * count, inputs, [struct_of(Screen, screen)])


@wp.func
def slope_of(x: float, y: float, z: float, w: vec16) -> wp.vec3:
    """Return the slope of the sum of harmonics times `w`, by a direction."""
    c1 = 0.4886025119029199
    c2 = 1.0925484305920792
    c3 = 0.5900435899266435
    c4 = 0.4570457994644658
    c5 = 2.890611442640554
    c6 = 1.445305721320277
    dx = -c1 * w[3] + c2 * (y * w[4] - z * w[7]) + c2 * x * w[8]
    dx += -c3 * (6.0 * x * y * w[9] + (3.0 * x * x - 3.0 * y * y) * w[15])
    dx += c5 * y * z * w[10] - c4 * (5.0 * z * z - 1.0) * w[13] + 2.0 * c6 * x * z * w[14]
    dy = -c1 * w[1] + c2 * (x * w[4] - z * w[5]) - c2 * y * w[8]
    dy += -c3 * ((3.0 * x * x - 3.0 * y * y) * w[9] - 6.0 * x * y * w[15])
    dy += c5 * x * z * w[10] - c4 * (5.0 * z * z - 1.0) * w[11] - 2.0 * c6 * y * z * w[14]
    dz = c1 * w[2] - c2 * (y * w[5] + x * w[7]) + 1.8923493915151202 * z * w[6]
    dz += c5 * x * y * w[10] - 4.570457994644658 * z * (y * w[11] + x * w[13])
    dz += 0.3731763325901154 * (15.0 * z * z - 3.0) * w[12] + c6 * (x * x - y * y) * w[14]
    return wp.vec3(dx, dy, dz)


@wp.func
def add_colors(splats: Splats, n: int, arm: wp.vec3, g: wp.vec3, d_splats: Splats) -> wp.vec3:
    """Add the gradients by coefficients; return that by the splat's position."""
    distance = wp.sqrt(dot(arm, arm))
    x = arm[0] / distance
    y = arm[1] / distance
    z = arm[2] / distance
    h = harmonics(x, y, z)
    gains = wp.vec3(0.0, 0.0, 0.0)
    for channel in range(3):
        if color_of(splats, n, h, channel) > 0.0:
            gains[channel] = g[channel]
    w = vec16()
    for channel in range(3):
        d_splats.colors[n, channel] = d_splats.colors[n, channel] + h[0] * gains[channel]
    for k in range(splats.sides.shape[1] // 3):
        for channel in range(3):
            at = 3 * k + channel
            w[k + 1] += gains[channel] * splats.sides[n, at]
            d_splats.sides[n, at] = d_splats.sides[n, at] + h[k + 1] * gains[channel]
    s = slope_of(x, y, z, w)
    along = s[0] * x + s[1] * y + s[2] * z
    return wp.vec3(
        (s[0] - along * x) / distance, (s[1] - along * y) / distance, (s[2] - along * z) / distance
    )


@wp.func
def add_turn(p: Placed, splats: Splats, n: int, d: wp.mat33, d_splats: Splats):
    """Add the gradient by a quaternion, given that by its rotation."""
    w = splats.turns[n, 0] / p.length
    x = splats.turns[n, 1] / p.length
    y = splats.turns[n, 2] / p.length
    z = splats.turns[n, 3] / p.length
    gw = z * (d[1, 0] - d[0, 1]) + y * (d[0, 2] - d[2, 0]) + x * (d[2, 1] - d[1, 2])
    gx = y * (d[0, 1] + d[1, 0]) + z * (d[0, 2] + d[2, 0]) + w * (d[2, 1] - d[1, 2])
    gx = gx - 2.0 * x * (d[1, 1] + d[2, 2])
    gy = x * (d[0, 1] + d[1, 0]) + z * (d[1, 2] + d[2, 1]) + w * (d[0, 2] - d[2, 0])
    gy = gy - 2.0 * y * (d[0, 0] + d[2, 2])
    gz = x * (d[0, 2] + d[2, 0]) + y * (d[1, 2] + d[2, 1]) + w * (d[1, 0] - d[0, 1])
    gz = gz - 2.0 * z * (d[0, 0] + d[1, 1])
    along = gw * w + gx * x + gy * y + gz * z
    factor = 2.0 / p.length
    d_splats.turns[n, 0] = d_splats.turns[n, 0] + factor * (gw - along * w)
    d_splats.turns[n, 1] = d_splats.turns[n, 1] + factor * (gx - along * x)
    d_splats.turns[n, 2] = d_splats.turns[n, 2] + factor * (gy - along * y)
    d_splats.turns[n, 3] = d_splats.turns[n, 3] + factor * (gz - along * z)


@wp.kernel
def project_backward_kernel(
    stride: int,
    first: int,
    last: int,
    splats: Splats,
    sight: Sight,
    lists: Lists,
    slopes: wp.array2d[float],  # (E, 9): gradients by a splat on the screen, entry by entry
    # outputs
    d_splats: Splats,
):
    """Add the gradients of a splat."""
    # By number, not by rank: a splat lies beside the next one in memory.
    for n in range(first + wp.tid(), last, stride):
        rank = lists.ranks[n]
        begin = int(0)
        if rank > 0:
            begin = lists.ends[rank - 1]
        end = wp.min(lists.ends[rank], slopes.shape[0])
        if begin >= 0 and begin < end:
            s = vec9()
            for entry in range(begin, end):
                for k in range(9):
                    s[k] += slopes[entry, k]
            p = placed(splats, sight, n)
            view = sight.view[0]
            arm = arm_of(splats, sight, n)
            moved = add_colors(splats, n, arm, wp.vec3(s[6], s[7], s[8]), d_splats)
            d_splats.opacities[n, 0] = d_splats.opacities[n, 0] + s[5] * p.opacity * (
                1.0 - p.opacity
            )
            # By the inverse covariance Q, then by the covariance: -Q G Q.
            determinant = p.a * p.c - p.b * p.b
            qa = p.c / determinant
            qb = -p.b / determinant
            qc = p.a / determinant
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
            d_turn = wp.mat33()
            d_across = wp.vec3(0.0, 0.0, 0.0)
            d_along = wp.vec3(0.0, 0.0, 0.0)
            for m in range(3):
                d_size = float(0.0)
                for j in range(3):
                    slope = p.across[j] * du[m] + p.along[j] * dv[m]
                    d_size += slope * p.turn[j, m]
                    d_turn[j, m] = slope * p.size[m]
                    d_across[j] += p.turn[j, m] * p.size[m] * du[m]
                    d_along[j] += p.turn[j, m] * p.size[m] * dv[m]
                d_splats.scales[n, m] = d_splats.scales[n, m] + d_size * p.size[m]
            add_turn(p, splats, n, d_turn, d_splats)
            right = axis_of(sight, view, 0)
            down = axis_of(sight, view, 1)
            ahead = axis_of(sight, view, 2)
            near = 1.0 / p.depth
            u2 = dot(d_across, ahead)
            v2 = dot(d_along, ahead)
            # The lens bends alike within a splat: its slopes `d` are taken as constant.
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
            # x = right . arm / depth, and so on.
            d_near += (dx * p.x + dy * p.y) * p.depth
            d_depth = -near * near * d_near
            for j in range(3):
                d_splats.means[n, j] = d_splats.means[n, j] + (
                    moved[j] + right[j] * (dx * near) + down[j] * (dy * near) + ahead[j] * d_depth
                )


def project_backward(
    splats: codes.Splats,
    sight: codes.Sight,
    lists: codes.Lists,
    slopes: wp.array,
    d_splats: codes.Splats,
) -> None:
    """Add the gradients of splats, given those of their entries on the screen, (E, 9).

    The entries of a splat are added in their order.
    """
    count = lists.order.shape[0]
    inputs = [
        struct_of(Splats, splats), struct_of(Sight, sight), struct_of(Lists, lists), slopes,
    ]  # fmt: skip
    launch_each(project_backward_kernel, count, 128 * count, inputs, [struct_of(Splats, d_splats)])
