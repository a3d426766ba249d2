"""Zero-mean normalised cross-correlation from sums over windows, in float64.

With n pixels in a window, and sums S over it, the correlation of the windows l and r is

    (n S(l r) - S(l) S(r)) / sqrt((n S(l l) - S(l)^2) (n S(r r) - S(r)^2))

where each of the three differences is summed over the channels.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.stereo import FLAT, Cost
from cvkern.kernels.taichi._launch import scratch
from cvkern.kernels.taichi._rounding import wide_product

from ._window_sums import inside, strip_rows, sum_windows

f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
f64_2 = ti.types.ndarray(dtype=ti.f64, ndim=2)
f64_3 = ti.types.ndarray(dtype=ti.f64, ndim=3)
any_3 = ti.types.ndarray(ndim=3)  # u8, i32, f32 or f64


@ti.kernel
def _moments_down(
    image: any_3,  # (H, W, C)
    radius_y: ti.i32,
    # outputs
    sums: f64_3,  # (H, W, C)
    squares: f64_3,
):
    for y, x, c in sums:
        total = ti.cast(0, ti.f64)
        square = ti.cast(0, ti.f64)
        for v in range(y - radius_y, y + radius_y + 1):
            value = ti.cast(image[inside(v, image.shape[0]), x, c], ti.f64)
            total += value
            square += value * value  # exact
        sums[y, x, c] = total
        squares[y, x, c] = square


@ti.kernel
def _moments_along(
    down: f64_3,  # (H, W, C)
    down_squares: f64_3,
    radius_x: ti.i32,
    n: ti.f64,
    zero: ti.i32,
    # outputs
    sums: f64_3,  # (H, W + 2 radius_x, C)
    scales: f64_2,  # (H, W + 2 radius_x)
):
    for y, j in scales:
        energy = ti.cast(0, ti.f64)
        spread = ti.cast(0, ti.f64)
        for c in range(sums.shape[2]):
            total = ti.cast(0, ti.f64)
            square = ti.cast(0, ti.f64)
            for u in range(j - 2 * radius_x, j + 1):
                x = inside(u, down.shape[1])
                total += down[y, x, c]
                square += down_squares[y, x, c]
            sums[y, j, c] = total
            part = wide_product(n, square, zero)
            energy += part
            spread += part - wide_product(total, total, zero)
        scale = ti.cast(0, ti.f64)
        if spread > FLAT * energy:
            scale = 1.0 / ti.sqrt(spread)
        scales[y, j] = scale


@ti.kernel
def _correlate(
    products: any_3,  # (rows of the strip, W, D)
    left_sums: f64_3,
    right_sums: f64_3,
    left_scales: f64_2,
    right_scales: f64_2,
    first: ti.i32,
    radius_x: ti.i32,
    n: ti.f64,
    top: ti.i32,
    zero: ti.i32,
    # outputs
    costs: f32_3,  # (rows of the strip, W, D)
):
    for i, x, k in costs:
        y = top + i
        at = x + radius_x
        partner = inside(at - first - k, right_scales.shape[1])
        covariance = wide_product(n, ti.cast(products[i, x, k], ti.f64), zero)
        for c in range(left_sums.shape[2]):
            covariance -= wide_product(left_sums[y, at, c], right_sums[y, partner, c], zero)
        scaled = wide_product(covariance, left_scales[y, at], zero)
        value = 1.0 - wide_product(scaled, right_scales[y, partner], zero)
        costs[i, x, k] = ti.cast(ti.min(ti.max(value, 0.0), 2.0), ti.f32)


def correlate_windows(
    left: np.ndarray,
    right: np.ndarray,
    first: int,
    radius_y: int,
    radius_x: int,
    costs: np.ndarray,
) -> None:
    """Fill the costs, one strip of rows at a time; one thread per cost."""
    height, width, depth = costs.shape
    wide = width + 2 * radius_x
    n = float((2 * radius_y + 1) * (2 * radius_x + 1))
    sums, scales = [], []
    for image in (left, right):
        down, squares = (scratch(left.shape, np.float64) for _ in range(2))
        _moments_down(image, radius_y, down, squares)
        sums.append(scratch((height, wide, left.shape[2]), np.float64))
        scales.append(scratch((height, wide), np.float64))
        _moments_along(down, squares, radius_x, n, 0, sums[-1], scales[-1])
    dtype = np.float64 if left.dtype == np.float32 else np.int32
    rows = strip_rows(height, wide * depth)
    for top in range(0, height, rows):
        part = costs[top : top + rows]
        products = scratch(part.shape, dtype)
        sum_windows(left, right, first, Cost.ZNCC, radius_y, radius_x, top, products)
        _correlate(products, *sums, *scales, first, radius_x, n, top, 0, part)
