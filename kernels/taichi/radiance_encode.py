"""Encodings of directions and positions, in Taichi."""

import numpy as np
import taichi as ti

from ._harmonics import harmonics
from ._launch import primitive

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)


@ti.kernel
def _spherical(
    directions: f32_2,  # (R, 3)
    rays: i32_1,  # (M,)
    total: i32_1,  # (1,)
    column: ti.i32,
    # outputs
    features: f32_2,  # (M, >= column + 16)
):
    for i in range(ti.min(total[0], features.shape[0])):
        ray = rays[i]
        h = harmonics(directions[ray, 0], directions[ray, 1], directions[ray, 2])
        for k in ti.static(range(16)):
            features[i, column + k] = h[k]


@primitive
def spherical(
    directions: np.ndarray, rays: np.ndarray, total: np.ndarray, column: int, features: np.ndarray
) -> None:
    """Write the spherical harmonics of the direction of each sample's ray, in 16 columns.

    `directions` (R, 3) are unit vectors, `rays` (M,) those of the first `total` (1,) samples;
    `features` (M, >= column + 16) is filled from `column` on.
    """
    _spherical(directions, rays, total, column, features)
