"""Rays through the pixels of cameras, in Taichi; one thread per ray."""

import numpy as np
import taichi as ti

from cvkern.kernels.codes import radiance as codes
from cvkern.kernels.codes.radiance import Draw
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._random import random_index, random_unit
from cvkern.kernels.taichi.geometry._lens import straightened

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)
vec3i = ti.types.vector(3, ti.i32)


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
    """Store the origin and the unit direction of the ray through a pixel."""
    at = straightened(lenses, view, row, column)
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
    """Make rays (R, 3) through pixel centres of a view, in raster order, beginning at `begin`."""
    poses, lenses, width, _ = cameras
    _view_rays(poses, lenses, view, width, begin, origins, directions)


@ti.kernel
def _random_rays(
    poses: f32_3,  # (N, 3, 4)
    lenses: f32_2,  # (N, 9)
    images: u8_2,  # (N H W, C)
    given: vec3i,  # width, height, seed
    spread: ti.f32,
    step: i32_1,  # (1,)
    chosen: i32_1,  # (V,)
    # outputs
    origins: f32_2,  # (R, 3)
    directions: f32_2,  # (R, 3)
    targets: f32_2,  # (R, 4)
    views: i32_1,  # (R,)
    pixels: i32_1,  # (R,)
):
    width, height, seed = given[0], given[1], given[2]
    for ray in range(origins.shape[0]):
        count = images.shape[0] if chosen[0] < 0 else chosen.shape[0]
        pixel = random_index(seed, step[0], ray, Draw.PIXEL, count)
        if chosen[0] >= 0:
            pixel = chosen[pixel]
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
        views[ray] = view
        pixels[ray] = within


@primitive
def random_rays(
    cameras: codes.CameraSet,
    images: np.ndarray,
    spread: float,
    seed: int,
    step: np.ndarray,
    chosen: np.ndarray,
    origins: np.ndarray,
    directions: np.ndarray,
    targets: np.ndarray,
    views: np.ndarray,
    pixels: np.ndarray,
) -> None:
    """Make rays (R, 3) through random pixels of all views, with the colours of these pixels.

    A ray goes through a random point of its pixel, `spread` pixels wide; 0 is the centre. `images`
    (N height width, 3 or 4) uint8 give `targets` (R, 4): the colour, and the opacity or 1. The
    pixels are drawn from the rows `chosen` (V,) of the images, or from all if the first one is
    negative. `views` (R,) are the photographs, and `pixels` (R,) the pixels within them.
    """
    poses, lenses, width, height = cameras
    _random_rays(
        poses, lenses, images, vec3i(width, height, seed), spread, step, chosen,
        origins, directions, targets, views, pixels,
    )  # fmt: skip
