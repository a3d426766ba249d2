"""Splats on the screen and the gradients by them, in Warp; the Taichi set has the equations."""

import warp as wp

from cvkern.kernels.codes import splats as codes
from cvkern.kernels.warp._launch import launch, launch_each
from cvkern.kernels.warp._structs import struct_of
from cvkern.kernels.warp.radiance._harmonics import harmonics, vec16

from . import _projection_cuda as cuda
from ._placing import FAINT, arm_of, dot, placed
from ._slopes import add_moves, entries_of, total_of, turned
from ._structs import Lists, Screen, Sight, Splats

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

TILE, CULLED = wp.constant(codes.TILE), wp.constant(codes.CULLED)
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
    return turned(x, y, z, distance, w)


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
        entries = entries_of(lists, n, slopes.shape[0])
        if entries[0] < entries[1]:
            s = total_of(slopes, entries)
            p = placed(splats, sight, n)
            arm = arm_of(splats, sight, n)
            moved = add_colors(splats, n, arm, wp.vec3(s[6], s[7], s[8]), d_splats)
            add_moves(p, s, moved, splats, sight, n, d_splats)


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
    if slopes.device.is_cuda:
        threads = -(-count // cuda.BLOCK) * cuda.BLOCK
        launch(cuda.project_backward, threads, inputs, [struct_of(Splats, d_splats)], cuda.BLOCK)
        return
    launch_each(project_backward_kernel, count, 128 * count, inputs, [struct_of(Splats, d_splats)])
