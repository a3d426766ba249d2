"""Encodings of directions and positions, in Warp."""

from functools import cache
from typing import Any

import warp as wp

from ._launch import launch_each

OPTIONS = {"enable_backward": False}  # of kernels that are made for a dtype

vec16 = wp.types.vector(16, wp.float32)


@wp.func
def harmonics(d: wp.vec3) -> vec16:
    """Real spherical harmonics of degree 0 to 3, orthonormal, in the order l^2 + l + m."""
    x = d[0]
    y = d[1]
    z = d[2]
    h = vec16()
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


@cache
def _spherical(scalar: Any) -> wp.Kernel:
    @wp.kernel(module="unique", module_options=OPTIONS)
    def spherical(
        stride: int,
        first: int,
        last: int,
        directions: wp.array2d[float],  # (R, 3)
        rays: wp.array[int],  # (M,)
        total: wp.array[int],  # (1,)
        column: int,
        # outputs
        features: wp.array2d[scalar],  # (M, >= column + 16)
    ):
        for i in range(first + wp.tid(), wp.min(last, total[0]), stride):
            ray = rays[i]
            h = harmonics(wp.vec3(directions[ray, 0], directions[ray, 1], directions[ray, 2]))
            for k in range(16):
                features[i, column + k] = scalar(h[k])

    return spherical


def spherical(
    directions: wp.array, rays: wp.array, total: wp.array, column: int, features: wp.array
) -> None:
    """Write the spherical harmonics of the direction of each sample's ray, in 16 columns.

    `directions` (R, 3) are unit vectors, `rays` (M,) those of the first `total` (1,) samples;
    `features` (M, >= column + 16) is filled from `column` on.
    """
    count = features.shape[0]
    launch_each(
        _spherical(features.dtype), count, 16 * count, [directions, rays, total, column], [features]
    )
