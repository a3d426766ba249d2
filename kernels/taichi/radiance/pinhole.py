"""Rays through the pixels of cameras, in Taichi."""

import numpy as np
import taichi as ti

from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.codes.radiance import Draw
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._random import random_index, random_unit

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)
vec2 = ti.types.vector(2, ti.f32)

NEWTON_STEPS = 5
WIDEST = 1.0e6  # tangent of the angle of a ray from the middle: farther is astray


@ti.func
def _undistorted(lenses: ti.template(), view: ti.i32, row: ti.f32, column: ti.f32) -> vec2:
    """Return the point, for f = 1, whose distorted image is at the pixel: Newton's method.

    Where there is none, it is any; not one so far away that a ray would have no direction.
    """
    k1 = lenses[view, 4]
    k2 = lenses[view, 5]
    p1 = lenses[view, 6]
    p2 = lenses[view, 7]
    k3 = lenses[view, 8]
    want_x = (column - lenses[view, 2]) / lenses[view, 0]
    want_y = (row - lenses[view, 3]) / lenses[view, 1]
    x = want_x
    y = want_y
    if k1 != 0.0 or k2 != 0.0 or p1 != 0.0 or p2 != 0.0 or k3 != 0.0:
        for _ in range(NEWTON_STEPS):
            r2 = x * x + y * y
            radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
            slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2))  # d radial / d x = slope x
            off_x = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) - want_x
            off_y = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y - want_y
            xx = radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x
            yy = radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x
            xy = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y  # the Jacobian is symmetric
            det = xx * yy - xy * xy
            x -= (yy * off_x - xy * off_y) / det
            y -= (xx * off_y - xy * off_x) / det
        if not (ti.abs(x) < WIDEST and ti.abs(y) < WIDEST):
            x, y = want_x, want_y
    return vec2(x, y)


@ti.func
def _write_ray(
    poses: ti.template(),
    lenses: ti.template(),
    view: ti.i32,
    row: ti.f32,
    column: ti.f32,
    ray: ti.i32,
    origins: ti.template(),
    directions: ti.template(),
):
    """Store where the ray through a pixel starts, and its unit direction."""
    at = _undistorted(lenses, view, row, column)
    ahead = ti.Vector([0.0, 0.0, 0.0])
    for k in ti.static(range(3)):
        ahead[k] = poses[view, k, 0] * at[0] + poses[view, k, 1] * at[1] + poses[view, k, 2]
    ahead /= ahead.norm()
    for k in ti.static(range(3)):
        origins[ray, k] = poses[view, k, 3]
        directions[ray, k] = ahead[k]


@ti.kernel
def _view_rays(
    poses: f32_3,  # (N, 3, 4)
    lenses: f32_2,  # (N, 9): fx fy cx cy k1 k2 p1 p2 k3
    view: ti.i32,
    width: ti.i32,
    begin: ti.i32,
    # outputs
    origins: f32_2,  # (R, 3)
    directions: f32_2,  # (R, 3)
):
    for ray in range(origins.shape[0]):
        pixel = begin + ray
        row = ti.cast(pixel // width, ti.f32)
        column = ti.cast(pixel % width, ti.f32)
        _write_ray(poses, lenses, view, row, column, ray, origins, directions)


@primitive
def view_rays(
    cameras: codes.CameraSet,
    view: int,
    begin: int,
    origins: np.ndarray,
    directions: np.ndarray,
) -> None:
    """Make rays (R, 3) through the pixel centres of a view, in raster order from `begin` on."""
    poses, lenses, width, _ = cameras
    _view_rays(poses, lenses, view, width, begin, origins, directions)


@ti.kernel
def _random_rays(
    poses: f32_3,  # (N, 3, 4)
    lenses: f32_2,  # (N, 9)
    images: u8_2,  # (N H W, C)
    width: ti.i32,
    height: ti.i32,
    spread: ti.f32,
    seed: ti.i32,
    step: i32_1,  # (1,)
    # outputs
    origins: f32_2,  # (R, 3)
    directions: f32_2,  # (R, 3)
    targets: f32_2,  # (R, 4)
):
    for ray in range(origins.shape[0]):
        pixel = random_index(seed, step[0], ray, Draw.PIXEL, images.shape[0])
        view = pixel // (width * height)
        within = pixel - view * (width * height)
        row = within // width
        column = within - row * width
        y = row + spread * (random_unit(seed, step[0], ray, Draw.PIXEL_Y) - 0.5)
        x = column + spread * (random_unit(seed, step[0], ray, Draw.PIXEL_X) - 0.5)
        _write_ray(poses, lenses, view, y, x, ray, origins, directions)
        for k in range(3):
            targets[ray, k] = images[pixel, k] / 255.0
        opacity = 1.0
        if images.shape[1] == 4:
            opacity = images[pixel, 3] / 255.0
        targets[ray, 3] = opacity


@primitive
def random_rays(
    cameras: codes.CameraSet,
    images: np.ndarray,
    spread: float,
    seed: int,
    step: np.ndarray,
    origins: np.ndarray,
    directions: np.ndarray,
    targets: np.ndarray,
) -> None:
    """Make rays (R, 3) through random pixels of all views, with what is seen there.

    A ray goes through a random point of its pixel, `spread` pixels wide; 0 is the centre. `images`
    (N height width, 3 or 4) uint8 give `targets` (R, 4): the colour, and the opacity or 1.
    """
    poses, lenses, width, height = cameras
    _random_rays(
        poses, lenses, images, width, height, spread, seed, step, origins, directions, targets
    )
