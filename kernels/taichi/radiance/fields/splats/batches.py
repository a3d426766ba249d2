"""Whole photographs as batches of training, in Taichi."""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive

u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)


@ti.kernel
def _photograph(
    images: u8_2,  # (N R, C)
    leap: ti.i32,
    seed: ti.i32,
    step: i32_1,  # (1,)
    # outputs
    view: i32_1,  # (1,)
    targets: f32_2,  # (R, 4)
    views: i32_1,  # (R,)
    pixels: i32_1,  # (R,)
):
    for ray in range(views.shape[0]):
        count = images.shape[0] // targets.shape[0]
        turn = ti.cast(step[0], ti.i64) * leap + seed
        chosen = ti.cast(turn % count, ti.i32)
        if ray == 0:
            view[0] = chosen
        pixel = chosen * targets.shape[0] + ray
        for k in ti.static(range(3)):
            targets[ray, k] = ti.cast(images[pixel, k], ti.f32) / 255.0
        targets[ray, 3] = 1.0
        if images.shape[1] == 4:
            targets[ray, 3] = ti.cast(images[pixel, 3], ti.f32) / 255.0
        views[ray] = chosen
        pixels[ray] = ray


@primitive
def photograph(
    images: np.ndarray,
    leap: int,
    seed: int,
    step: np.ndarray,
    view: np.ndarray,
    targets: np.ndarray,
    views: np.ndarray,
    pixels: np.ndarray,
) -> None:
    """Choose photograph (`step` `leap` + `seed`) mod N, and show all of its pixels.

    `images` (N R, 3 or 4) uint8 give `targets` (R, 4): the colour, and the opacity or 1. `view`
    (1,) and `views` (R,) are the photograph, and `pixels` (R,) count its pixels.
    """
    _photograph(images, leap, seed, step, view, targets, views, pixels)
