"""The place of a splat on the screen, in Taichi; projection.py has the equations."""

from typing import Any

import taichi as ti

from cvkern.kernels.codes.splats import FAINT

vec3 = ti.types.vector(3, ti.f32)
vec4 = ti.types.vector(4, ti.f32)
mat3 = ti.types.matrix(3, 3, ti.f32)

BESIDE = 0.3  # room beside the image, half widths, where slopes of the map go on

Extent = ti.types.struct(width=ti.i32, height=ti.i32, near=ti.f32, blur=ti.f32)
"""The numbers of `Sight`."""

# A splat before a camera: the direction (x, y) before the lens bends it; its column and row, and
# their slopes `d` by x, then y; the slopes of both by the frame's coordinates, `across` and
# `along`, taken at (slope_x, slope_y); rotation, standard deviations, and the quaternion's length;
# slopes `u` and `v` by the splat's own coordinates, and the covariance on the screen, a b c.
Placed = ti.types.struct(
    seen=ti.i32, depth=ti.f32, x=ti.f32, y=ti.f32, column=ti.f32, row=ti.f32, d=vec4,
    slope_x=ti.f32, slope_y=ti.f32, across=vec3, along=vec3, turn=mat3, size=vec3,
    length=ti.f32, u=vec3, v=vec3, a=ti.f32, b=ti.f32, c=ti.f32, opacity=ti.f32,
)  # fmt: skip


@ti.func
def exponential(x: ti.f32) -> ti.f32:
    """Return e^x for x from -87 to 88, by the same operations in both sets."""
    t = ti.min(ti.max(x, -87.0), 88.0) * 1.4426950408889634
    n = ti.floor(t + 0.5)
    f = t - n
    p = 1.5252734e-5 * f + 1.5403530e-4
    p = p * f + 1.3333558e-3
    p = p * f + 9.6181291e-3
    p = p * f + 5.5504109e-2
    p = p * f + 2.4022651e-1
    p = p * f + 6.9314718e-1
    p = p * f + 1.0
    return p * ti.bit_cast((ti.cast(n, ti.i32) + 127) << 23, ti.f32)


@ti.func
def turn_of(w: ti.f32, x: ti.f32, y: ti.f32, z: ti.f32) -> mat3:
    """Return the rotation of a quaternion of length 1."""
    return mat3(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


@ti.func
def dot(a: vec3, b: vec3) -> ti.f32:
    """Return the product, summed from the left."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@ti.func
def axis_of(poses: ti.template(), view: ti.i32, k: ti.i32) -> vec3:
    """Return an axis of the camera in the frame."""
    return vec3(poses[view, 0, k], poses[view, 1, k], poses[view, 2, k])


@ti.func
def arm_of(means: ti.template(), poses: ti.template(), view: ti.i32, n: ti.i32) -> vec3:
    """Return the way from the camera to a splat."""
    return vec3(
        means[n, 0] - poses[view, 0, 3],
        means[n, 1] - poses[view, 1, 3],
        means[n, 2] - poses[view, 2, 3],
    )


@ti.func
def _slope_between(value: ti.f32, center: ti.f32, focal: ti.f32, count: ti.i32) -> ti.f32:
    """Return the coordinate of a direction, moved into the image with some room beside it."""
    half = 0.5 * ti.cast(count, ti.f32) / focal
    low = -center / focal - BESIDE * half
    high = (ti.cast(count, ti.f32) - center) / focal + BESIDE * half
    return ti.min(ti.max(value, low), high)


@ti.func
def placed(
    means: ti.template(), turns: ti.template(), scales: ti.template(), opacities: ti.template(),
    poses: ti.template(), lenses: ti.template(), view: ti.i32, extent: Extent, n: ti.i32,
) -> Any:  # fmt: skip
    """Return where a splat is."""
    p = Placed(0)
    arm = arm_of(means, poses, view, n)
    right, down, ahead = (
        axis_of(poses, view, 0),
        axis_of(poses, view, 1),
        axis_of(poses, view, 2),
    )
    p.depth = dot(ahead, arm)
    w, i, j, k = turns[n, 0], turns[n, 1], turns[n, 2], turns[n, 3]
    p.length = ti.sqrt(w * w + i * i + j * j + k * k)
    p.opacity = 1.0 / (1.0 + exponential(-opacities[n, 0]))
    p.seen = ti.cast(p.depth > extent.near and p.length > 1e-12 and p.opacity >= FAINT, ti.i32)
    if p.seen == 1:
        near = 1.0 / p.depth
        x = dot(right, arm) * near
        y = dot(down, arm) * near
        fx, fy, cx, cy = lenses[view, 0], lenses[view, 1], lenses[view, 2], lenses[view, 3]
        k1, k2, k3 = lenses[view, 4], lenses[view, 5], lenses[view, 8]
        p1, p2 = lenses[view, 6], lenses[view, 7]
        r = x * x + y * y
        f = 1.0 + r * (k1 + r * (k2 + r * k3))
        g = k1 + r * (2.0 * k2 + r * (3.0 * k3))
        p.x = x
        p.y = y
        p.column = fx * (x * f + 2.0 * p1 * x * y + p2 * (r + 2.0 * x * x)) + cx
        p.row = fy * (y * f + p1 * (r + 2.0 * y * y) + 2.0 * p2 * x * y) + cy
        xx = f + 2.0 * x * x * g + 2.0 * p1 * y + 6.0 * p2 * x
        xy = 2.0 * x * y * g + 2.0 * p1 * x + 2.0 * p2 * y
        yy = f + 2.0 * y * y * g + 6.0 * p1 * y + 2.0 * p2 * x
        unfolded = xx * yy - xy * xy > 0.0  # farther out, the map of the lens folds back
        p.d = vec4(fx * xx, fx * xy, fy * xy, fy * yy)
        p.slope_x = _slope_between(x, cx, fx, extent.width)
        p.slope_y = _slope_between(y, cy, fy, extent.height)
        u2 = -(p.d[0] * p.slope_x + p.d[1] * p.slope_y) * near
        v2 = -(p.d[2] * p.slope_x + p.d[3] * p.slope_y) * near
        p.across = (p.d[0] * near) * right + (p.d[1] * near) * down + u2 * ahead
        p.along = (p.d[2] * near) * right + (p.d[3] * near) * down + v2 * ahead
        p.turn = turn_of(w / p.length, i / p.length, j / p.length, k / p.length)
        for m in ti.static(range(3)):
            p.size[m] = exponential(scales[n, m])
            column = vec3(p.turn[0, m], p.turn[1, m], p.turn[2, m])
            p.u[m] = dot(p.across, column) * p.size[m]
            p.v[m] = dot(p.along, column) * p.size[m]
        p.a = dot(p.u, p.u) + extent.blur
        p.b = dot(p.u, p.v)
        p.c = dot(p.v, p.v) + extent.blur
        determinant = p.a * p.c - p.b * p.b
        p.seen = ti.cast(unfolded and 0.0 < determinant < ti.math.inf, ti.i32)
    return p
