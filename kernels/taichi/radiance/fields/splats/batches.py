"""Whole photographs as batches of training, in Taichi."""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive

u8_1 = ti.types.ndarray(dtype=ti.u8, ndim=1)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
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


@ti.kernel
def _leave_out(
    masks: u8_1,  # (N R,)
    view: i32_1,  # (1,)
    # outputs
    errors: f32_1,  # (R,)
    d_color: f32_2,  # (R, 3)
    d_opacity: f32_1,  # (R,)
    d_learnt: f32_2,  # (R, 3)
):
    for ray in range(errors.shape[0]):
        if masks[view[0] * errors.shape[0] + ray] == 0:
            errors[ray] = -1.0
            d_opacity[ray] = 0.0
            for k in ti.static(range(3)):
                d_color[ray, k] = 0.0
                d_learnt[ray, k] = 0.0


@primitive
def leave_out(
    masks: np.ndarray,
    view: np.ndarray,
    errors: np.ndarray,
    d_color: np.ndarray,
    d_opacity: np.ndarray,
    d_learnt: np.ndarray,
) -> None:
    """Clear the gradients of R pixels where the mask of a photograph is 0; errors become -1 there.

    `masks` (N R,) uint8 are those of all photographs, and `view` (1,) is the number of this one.
    """
    _leave_out(masks, view, errors, d_color, d_opacity, d_learnt)
