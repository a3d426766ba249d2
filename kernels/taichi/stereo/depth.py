"""Depth, points and point clouds from disparities, in Taichi.

Depth is scale / (disparity + doffs). A point is (X, Y, Z) / W with (X, Y, Z, W) = Q (x, y, d, 1).
One thread per pixel, or per part of a row for point clouds.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._rounding import product, quotient

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)
u8_3 = ti.types.ndarray(dtype=ti.u8, ndim=3)

# Floats are classified by their bits, because the CUDA compiler assumes that there is no NaN.
INFINITY, NAN, MAGNITUDE = 0x7F800000, 0x7FC00000, 0x7FFFFFFF


@ti.func
def _is_finite(value: ti.f32) -> ti.i32:
    return (ti.bit_cast(value, ti.i32) & MAGNITUDE) < INFINITY


@ti.kernel
def _depth(
    disparity: f32_2,
    scale: ti.f32,
    doffs: ti.f32,
    zero: ti.i32,
    # outputs
    depth: f32_2,
):
    for y, x in disparity:
        s = disparity[y, x] + doffs
        bits = ti.bit_cast(s, ti.i32)
        z = ti.bit_cast(NAN, ti.f32)
        if bits & MAGNITUDE == 0:
            z = ti.bit_cast(INFINITY, ti.f32)
        elif 0 < bits and bits < INFINITY:
            z = quotient(scale, s, zero)
        depth[y, x] = z


@primitive
def depth(disparity: np.ndarray, scale: float, doffs: float, depth: np.ndarray) -> None:
    """Compute ``scale / (disparity + doffs)``; one thread per pixel.

    The result is infinite for a sum of 0, and NaN for a sum that is negative or not finite.
    """
    _depth(disparity, scale, doffs, 0, depth)


@ti.func
def _mapped(q: ti.template(), row: ti.i32, x: ti.f32, y: ti.f32, d: ti.f32, zero: ti.i32) -> ti.f32:
    """Return one coordinate of q (x, y, d, 1)."""
    total = product(q[row, 0], x, zero) + product(q[row, 1], y, zero)
    return total + product(q[row, 2], d, zero) + q[row, 3]


@ti.kernel
def _points(
    disparity: f32_2,  # (H, W)
    q: f32_2,  # (4, 4)
    zero: ti.i32,
    # outputs
    points: f32_3,  # (H, W, 3)
):
    for y, x in disparity:
        d = disparity[y, x]
        u, v = ti.cast(x, ti.f32), ti.cast(y, ti.f32)
        w = _mapped(q, 3, u, v, d, zero)
        exists = _is_finite(d) and ti.bit_cast(w, ti.i32) & MAGNITUDE != 0
        for k in range(3):
            value = ti.bit_cast(NAN, ti.f32)
            if exists:
                value = quotient(_mapped(q, k, u, v, d, zero), w, zero)
            points[y, x, k] = value


@primitive
def points(disparity: np.ndarray, q: np.ndarray, points: np.ndarray) -> None:
    """Map (x, y, disparity, 1) by the matrix `q` and divide by the last coordinate.

    NaN where the disparity is not finite or that coordinate is 0. One thread per pixel.
    """
    _points(disparity, q, 0, points)


@ti.func
def _is_kept(points: ti.template(), mask: ti.template(), y: ti.i32, x: ti.i32) -> ti.i32:
    """Tell whether a pixel has a finite point and is set in the mask, if there is a mask."""
    kept = mask[ti.min(y, mask.shape[0] - 1), ti.min(x, mask.shape[1] - 1)] != 0
    for k in ti.static(range(3)):
        kept = kept and _is_finite(points[y, x, k])
    return kept


@ti.kernel
def _count_points(
    points: f32_3,  # (H, W, 3)
    mask: u8_2,  # (H, W) or (1, 1)
    # outputs
    counts: i32_2,  # (H, parts)
):
    for y, part in counts:
        width = (points.shape[1] + counts.shape[1] - 1) // counts.shape[1]
        count = 0
        for x in range(part * width, ti.min((part + 1) * width, points.shape[1])):
            if _is_kept(points, mask, y, x):
                count += 1
        counts[y, part] = count


@primitive
def count_points(points: np.ndarray, mask: np.ndarray, counts: np.ndarray) -> None:
    """Count the finite points of each part of a row where `mask` is not 0; one thread per part.

    The shape of `counts` gives the number of parts, of equal width, of a row. A mask of shape
    (1, 1) means all pixels.
    """
    _count_points(points, mask, counts)


@ti.kernel
def _gather_points(
    points: f32_3,  # (H, W, 3)
    mask: u8_2,  # (H, W) or (1, 1)
    image: u8_3,  # (H, W, 1 or 3)
    starts: i32_2,  # (H, parts)
    # outputs
    cloud: f32_2,  # (N, 3)
    colors: u8_2,  # (N, 3)
):
    for y, part in starts:
        width = (points.shape[1] + starts.shape[1] - 1) // starts.shape[1]
        i = starts[y, part]
        for x in range(part * width, ti.min((part + 1) * width, points.shape[1])):
            if _is_kept(points, mask, y, x):
                for k in range(3):
                    cloud[i, k] = points[y, x, k]
                    colors[i, k] = image[y, x, ti.min(k, image.shape[2] - 1)]
                i += 1


@primitive
def gather_points(
    points: np.ndarray,
    mask: np.ndarray,
    image: np.ndarray,
    starts: np.ndarray,
    cloud: np.ndarray,
    colors: np.ndarray,
) -> None:
    """Copy the points that `count_points` counts, and their colours; `starts` gives their places.

    An image of one channel gives grey. One thread per part.
    """
    _gather_points(points, mask, image, starts, cloud, colors)
