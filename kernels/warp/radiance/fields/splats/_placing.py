"""The place of a splat on the screen, in Warp; the Taichi set has the equations.

Sums are written out, term by term, so that both sets round alike on the CPU.
"""

import warp as wp

from cvkern.kernels.codes import splats as codes

from ._structs import Sight, Splats

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

FAINT = wp.constant(codes.FAINT)
BESIDE = wp.constant(0.3)  # room beside the image, half widths, where slopes of the map go on
LOG2_E = wp.constant(1.4426950408889634)


@wp.struct
class Placed:
    """A splat before a camera."""

    seen: bool
    depth: float
    x: float  # the direction, before the lens bends it
    y: float
    column: float
    row: float
    d: wp.vec4  # slopes of column and row by x, then y: xx, xy, yx, yy
    slope_x: float  # x and y where slopes are taken
    slope_y: float
    across: wp.vec3  # slopes of the column by the frame's coordinates
    along: wp.vec3  # those of the row
    turn: wp.mat33
    size: wp.vec3  # standard deviations
    length: float  # length of the quaternion
    u: wp.vec3  # slopes of the column by the splat's own coordinates, in standard deviations
    v: wp.vec3
    a: float  # covariance on the screen
    b: float
    c: float
    opacity: float


@wp.func
def exponential(x: float) -> float:
    """Return e^x for x from -87 to 88, by the same operations in both sets."""
    t = wp.clamp(x, -87.0, 88.0) * LOG2_E
    n = wp.floor(t + 0.5)
    f = t - n
    p = 1.5252734e-5 * f + 1.5403530e-4
    p = p * f + 1.3333558e-3
    p = p * f + 9.6181291e-3
    p = p * f + 5.5504109e-2
    p = p * f + 2.4022651e-1
    p = p * f + 6.9314718e-1
    p = p * f + 1.0
    return p * wp.cast((int(n) + 127) << 23, float)


@wp.func
def turn_of(w: float, x: float, y: float, z: float) -> wp.mat33:
    """Return the rotation of a quaternion of length 1."""
    return wp.mat33(
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        1.0 - 2.0 * (x * x + y * y),
    )


@wp.func
def dot(a: wp.vec3, b: wp.vec3) -> float:
    """Return the product, summed from the left."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@wp.func
def axis_of(sight: Sight, view: int, k: int) -> wp.vec3:
    """Return an axis of the camera in the frame."""
    return wp.vec3(sight.poses[view, 0, k], sight.poses[view, 1, k], sight.poses[view, 2, k])


@wp.func
def arm_of(splats: Splats, sight: Sight, n: int) -> wp.vec3:
    """Return the way from the camera to a splat."""
    view = sight.view[0]
    return wp.vec3(
        splats.means[n, 0] - sight.poses[view, 0, 3],
        splats.means[n, 1] - sight.poses[view, 1, 3],
        splats.means[n, 2] - sight.poses[view, 2, 3],
    )


@wp.func
def slope_between(value: float, center: float, focal: float, count: int) -> float:
    """Return the coordinate of a direction, moved into the image with some room beside it."""
    half = 0.5 * float(count) / focal
    low = -center / focal - BESIDE * half
    high = (float(count) - center) / focal + BESIDE * half
    return wp.clamp(value, low, high)


@wp.func
def placed(splats: Splats, sight: Sight, n: int) -> Placed:
    """Return where a splat is."""
    view = sight.view[0]
    p = Placed()
    arm = arm_of(splats, sight, n)
    right = axis_of(sight, view, 0)
    down = axis_of(sight, view, 1)
    ahead = axis_of(sight, view, 2)
    p.depth = dot(ahead, arm)
    w = splats.turns[n, 0]
    i = splats.turns[n, 1]
    j = splats.turns[n, 2]
    k = splats.turns[n, 3]
    p.length = wp.sqrt(w * w + i * i + j * j + k * k)
    p.opacity = 1.0 / (1.0 + exponential(-splats.opacities[n, 0]))
    p.seen = p.depth > sight.near and p.length > 1e-12 and p.opacity >= FAINT
    if p.seen:
        near = 1.0 / p.depth
        x = dot(right, arm) * near
        y = dot(down, arm) * near
        fx = sight.lenses[view, 0]
        fy = sight.lenses[view, 1]
        cx = sight.lenses[view, 2]
        cy = sight.lenses[view, 3]
        k1 = sight.lenses[view, 4]
        k2 = sight.lenses[view, 5]
        p1 = sight.lenses[view, 6]
        p2 = sight.lenses[view, 7]
        k3 = sight.lenses[view, 8]
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
        p.seen = xx * yy - xy * xy > 0.0  # farther out, the map of the lens folds back
        p.d = wp.vec4(fx * xx, fx * xy, fy * xy, fy * yy)
        sx = slope_between(x, cx, fx, sight.width)
        sy = slope_between(y, cy, fy, sight.height)
        p.slope_x = sx
        p.slope_y = sy
        u0 = p.d[0] * near
        u1 = p.d[1] * near
        u2 = -(p.d[0] * sx + p.d[1] * sy) * near
        v0 = p.d[2] * near
        v1 = p.d[3] * near
        v2 = -(p.d[2] * sx + p.d[3] * sy) * near
        p.across = u0 * right + u1 * down + u2 * ahead
        p.along = v0 * right + v1 * down + v2 * ahead
        p.turn = turn_of(w / p.length, i / p.length, j / p.length, k / p.length)
        for m in range(3):
            p.size[m] = exponential(splats.scales[n, m])
            column = wp.vec3(p.turn[0, m], p.turn[1, m], p.turn[2, m])
            p.u[m] = dot(p.across, column) * p.size[m]
            p.v[m] = dot(p.along, column) * p.size[m]
        p.a = dot(p.u, p.u) + sight.blur
        p.b = dot(p.u, p.v)
        p.c = dot(p.v, p.v) + sight.blur
        determinant = p.a * p.c - p.b * p.b
        p.seen = p.seen and determinant > 0.0 and wp.isfinite(determinant)
    return p
