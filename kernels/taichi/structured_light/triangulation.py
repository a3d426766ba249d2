"""Triangulation of projector columns or rows to points in space, in Taichi.

A column of the projector lights a plane. The ray d of a camera pixel meets it at the depth
``z = (x t_z - t_x) / ((R d)_x - x (R d)_z)``, where (R, t) is the pose of the projector and x the
undistorted column over its focal length. A lens bends the column into a curve. The depth is then
found by Newton's method in w = 1 / z, of which the column where the projector sees R d + w t is
almost a linear function. One thread computes one pixel.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.structured_light import LENS_STEPS, NEAR, STILL
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi.geometry._lens import NEWTON_STEPS, WIDEST

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
vec2 = ti.types.vector(2, ti.f32)
vec5 = ti.types.vector(5, ti.f32)


@primitive
def intersect(
    places: np.ndarray,
    valid: np.ndarray,
    lenses: np.ndarray,
    pose: np.ndarray,
    axis: int,
    points: np.ndarray,
) -> None:
    """Meet the rays of a camera with the planes of a projector's lines; one thread a pixel.

    `places` are columns (axis 0) or rows (axis 1), NaN or below -0.5 where unknown; `valid` is 0
    where they shall not count, or has one element. `lenses` are those of the camera and of the
    projector, `pose` is the rotation and the translation between them.
    """
    _intersect(places, valid, lenses, pose, axis, points)


@ti.func
def _bent(lenses: ti.template(), view: ti.i32, x: ti.f32, y: ti.f32) -> vec5:
    """Return the place where a ray is seen, for f = 1, and its derivatives xx, xy, yy.

    The operations have the order of Warp's header, which gives both sets equal bits on the CPU.
    """
    k1 = lenses[view, 4]
    k2 = lenses[view, 5]
    p1 = lenses[view, 6]
    p2 = lenses[view, 7]
    k3 = lenses[view, 8]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2))  # d radial / d x = slope x
    b = 2.0 * (p1 * x + p2 * y)
    c = 2.0 * p1 * y
    d = 2.0 * p2 * x
    return vec5(
        x * (radial + c) + p2 * (r2 + 2.0 * x * x),
        y * (radial + d) + p1 * (r2 + 2.0 * y * y),
        radial + slope * x * x + c + 3.0 * d,
        slope * x * y + b,
        radial + slope * y * y + 3.0 * c + d,
    )


@ti.func
def _straightened(lenses: ti.template(), row: ti.f32, column: ti.f32) -> vec2:
    """Return the point, for f = 1, whose distorted image is at the pixel: Newton's method.

    If there is none, the result is arbitrary, but never so far away that a ray has no direction.
    """
    want_x = (column - lenses[0, 2]) / lenses[0, 0]
    want_y = (row - lenses[0, 3]) / lenses[0, 1]
    x = want_x
    y = want_y
    goes = True
    for _ in range(NEWTON_STEPS):
        if goes:
            seen = _bent(lenses, 0, x, y)
            inverse = 1.0 / (seen[2] * seen[4] - seen[3] * seen[3])  # the Jacobian is symmetric
            off_x = (seen[0] - want_x) * inverse
            off_y = (seen[1] - want_y) * inverse
            step_x = seen[4] * off_x - seen[3] * off_y
            step_y = seen[2] * off_y - seen[3] * off_x
            x -= step_x
            y -= step_y
            goes = not (ti.abs(step_x) < STILL and ti.abs(step_y) < STILL)
    if not (ti.abs(x) < WIDEST and ti.abs(y) < WIDEST):
        x, y = want_x, want_y
    return vec2(x, y)


@ti.kernel
def _intersect(
    places: f32_2,  # (H, W)
    valid: u8_2,  # (H, W), or (1, 1)
    lenses: f32_2,  # (2, 9)
    pose: f32_1,  # (12,)
    axis: ti.template(),
    # outputs
    points: f32_3,  # (H, W, 3)
):
    for i, j in places:
        place = places[i, j]
        known = place >= -0.5
        if valid.shape[0] == places.shape[0] and valid.shape[1] == places.shape[1]:
            known = known and valid[i, j] != 0
        ray = _straightened(lenses, ti.cast(i, ti.f32), ti.cast(j, ti.f32))
        x = ray[0]
        y = ray[1]
        across = pose[0] * x + pose[1] * y + pose[2]
        down = pose[3] * x + pose[4] * y + pose[5]
        ahead = pose[6] * x + pose[7] * y + pose[8]
        wanted = (place - lenses[1, 2 + axis]) / lenses[1, axis]
        along = across
        shift = pose[9]
        if ti.static(axis == 1):
            along = down
            shift = pose[10]
        w = (along - wanted * ahead) / (wanted * pose[11] - shift)  # without a lens
        off = 0.0
        depth = 0.0
        goes = True
        for _ in range(LENS_STEPS):
            if goes:
                depth = ahead + w * pose[11]
                inverse = 1.0 / depth
                p = (across + w * pose[9]) * inverse
                q = (down + w * pose[10]) * inverse
                dp = (pose[9] - p * pose[11]) * inverse
                dq = (pose[10] - q * pose[11]) * inverse
                seen = _bent(lenses, 1, p, q)
                slope = seen[2] * dp + seen[3] * dq
                off = seen[0] - wanted
                if ti.static(axis == 1):
                    slope = seen[3] * dp + seen[4] * dq
                    off = seen[1] - wanted
                w -= off / slope
                goes = not ti.abs(off) < STILL
        z = 1.0 / w
        known = known and ti.abs(off) < NEAR and w > 0.0 and depth > 0.0
        if not known or ti.math.isnan(z) or ti.math.isinf(z):
            z = ti.math.nan
        points[i, j, 0] = z * x
        points[i, j, 1] = z * y
        points[i, j, 2] = z
