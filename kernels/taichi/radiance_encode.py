"""Encodings of directions and positions, in Taichi."""

import numpy as np
import taichi as ti

from ._launch import primitive

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
vec16 = ti.types.vector(16, ti.f32)


@ti.func
def harmonics(x: ti.f32, y: ti.f32, z: ti.f32) -> vec16:
    """Real spherical harmonics of degree 0 to 3, orthonormal, in the order l^2 + l + m."""
    h = vec16(0.0)
    h[0] = 0.28209479177387814
    h[1] = -0.4886025119029199 * y
    h[2] = 0.4886025119029199 * z
    h[3] = -0.4886025119029199 * x
    h[4] = 1.0925484305920792 * x * y
    h[5] = -1.0925484305920792 * y * z
    h[6] = 0.31539156525252005 * (3.0 * z * z - 1.0)
    h[7] = -1.0925484305920792 * x * z
    h[8] = 0.5462742152960396 * (x * x - y * y)
    h[9] = -0.5900435899266435 * y * (3.0 * x * x - y * y)
    h[10] = 2.890611442640554 * x * y * z
    h[11] = -0.4570457994644658 * y * (5.0 * z * z - 1.0)
    h[12] = 0.3731763325901154 * z * (5.0 * z * z - 3.0)
    h[13] = -0.4570457994644658 * x * (5.0 * z * z - 1.0)
    h[14] = 1.445305721320277 * z * (x * x - y * y)
    h[15] = -0.5900435899266435 * x * (x * x - 3.0 * y * y)
    return h


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
