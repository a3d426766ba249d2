"""The census transform and the Hamming distance, in Taichi."""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive

from ._window_sums import inside, ones

any_3 = ti.types.ndarray(ndim=3)  # u8 or f32
u8_3 = ti.types.ndarray(dtype=ti.u8, ndim=3)
u64_3 = ti.types.ndarray(dtype=ti.u64, ndim=3)


@ti.kernel
def _census(
    image: any_3,  # (H, W, C)
    radius_y: ti.i32,
    radius_x: ti.i32,
    spacing: ti.i32,
    symmetric: ti.i32,
    # outputs
    bits: u64_3,  # (H, W, C)
):
    for y, x, c in bits:
        word = ti.u64(0)
        n = 0
        for dy in range(-radius_y, radius_y + 1):
            for dx in range(-radius_x, radius_x + 1):
                before = dy < 0 or (dy == 0 and dx < 0)
                if before or (symmetric == 0 and not (dy == 0 and dx == 0)):
                    v = dy * spacing
                    u = dx * spacing
                    a = image[inside(y + v, image.shape[0]), inside(x + u, image.shape[1]), c]
                    v *= -symmetric
                    u *= -symmetric
                    b = image[inside(y + v, image.shape[0]), inside(x + u, image.shape[1]), c]
                    if a < b:
                        word |= ti.u64(1) << ti.cast(n, ti.u64)
                    n += 1
        bits[y, x, c] = word


@primitive
def census(
    image: np.ndarray,
    radius_y: int,
    radius_x: int,
    spacing: int,
    symmetric: bool,
    bits: np.ndarray,
) -> None:
    """Compute the census of uint8 or float32 (H, W, C); one thread per element."""
    _census(image, radius_y, radius_x, spacing, int(symmetric), bits)


@ti.kernel
def _hamming(
    left: u64_3,  # (H, W, C)
    right: u64_3,  # (H, W, C)
    first: ti.i32,
    # outputs
    costs: u8_3,  # (H, W, D)
):
    for y, x, k in costs:
        partner = inside(x - first - k, right.shape[1])
        total = 0
        for c in range(left.shape[2]):
            total += ones(left[y, x, c] ^ right[y, partner, c])
        costs[y, x, k] = ti.cast(total, ti.u8)


@primitive
def hamming(left: np.ndarray, right: np.ndarray, first: int, costs: np.ndarray) -> None:
    """Count differing bits, for each pixel and each disparity from `first` on; one thread each."""
    _hamming(left, right, first, costs)
