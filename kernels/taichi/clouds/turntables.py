"""Pictures of point clouds, in Taichi: an integer minimum decides which point is visible.

A point is a square in the view of a pinhole camera. Its key has the depth in the higher bits and
the number of the point in the lower bits; each sample keeps the smallest key that falls on it. One
thread per point draws; then one thread per channel of a pixel averages its samples.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.clouds import FAR, LARGEST_SPLAT
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._rounding import product, quotient

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i64_2 = ti.types.ndarray(dtype=ti.i64, ndim=2)
u8_1 = ti.types.ndarray(dtype=ti.u8, ndim=1)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)
u8_3 = ti.types.ndarray(dtype=ti.u8, ndim=3)


@ti.func
def _moved(
    pose: ti.template(), row: ti.i32, x: ti.f32, y: ti.f32, z: ti.f32, zero: ti.i32
) -> ti.f32:
    """Return one coordinate of a point in the camera at `pose`."""
    total = product(pose[row, 0], x, zero) + product(pose[row, 1], y, zero)
    return total + product(pose[row, 2], z, zero) + pose[row, 3]


@ti.func
def _first_sample(middle: ti.f32, half: ti.f32) -> ti.i32:
    """Return the first sample whose centre a square covers, or the nearest if it covers none."""
    first = ti.ceil(middle - half)
    if first >= middle + half:
        first = ti.floor(middle + 0.5)
    return ti.cast(first, ti.i32)


@ti.kernel
def _splat(
    points: f32_2,  # (N, 3)
    pose: f32_2,  # (3, 4)
    focal: ti.f32,
    cx: ti.f32,
    cy: ti.f32,
    size: ti.f32,
    zero: ti.i32,
    # outputs
    keys: i64_2,  # (H, W)
):
    for row, column in keys:
        keys[row, column] = ti.i64(FAR)
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        depth = _moved(pose, 2, x, y, z, zero)
        if z > 0.0 and depth > 0.0:
            u = product(quotient(_moved(pose, 0, x, y, z, zero), depth, zero), focal, zero) + cx
            v = product(quotient(_moved(pose, 1, x, y, z, zero), depth, zero), focal, zero) + cy
            side = ti.min(product(quotient(z, depth, zero), size, zero), LARGEST_SPLAT)
            half = 0.5 * side
            if (
                u + half > -0.5
                and v + half > -0.5
                and u - half < ti.cast(keys.shape[1], ti.f32) + 0.5
                and v - half < ti.cast(keys.shape[0], ti.f32) + 0.5
            ):
                left = _first_sample(u, half)
                top = _first_sample(v, half)
                right = ti.max(ti.cast(ti.ceil(u + half), ti.i32), left + 1)
                bottom = ti.max(ti.cast(ti.ceil(v + half), ti.i32), top + 1)
                # Bits of positive floats have the order of their values; a tie shows the first.
                key = (ti.cast(ti.bit_cast(depth, ti.i32), ti.i64) << 32) | ti.cast(i, ti.i64)
                for row in range(ti.max(top, 0), ti.min(bottom, keys.shape[0])):
                    for column in range(ti.max(left, 0), ti.min(right, keys.shape[1])):
                        ti.atomic_min(keys[row, column], key)


@primitive
def splat(
    points: np.ndarray,
    pose: np.ndarray,
    focal: float,
    cx: float,
    cy: float,
    size: float,
    keys: np.ndarray,
) -> None:
    """Write the key of the nearest point of each sample, or FAR; one thread per point.

    A point is a square of `size` samples in the view of the camera at the origin. In the view of
    the camera at `pose`, its size is in inverse proportion to its depth. Points behind either
    camera are not drawn.
    """
    _splat(points, pose, focal, cx, cy, size, 0, keys)


@ti.kernel
def _shade(
    keys: i64_2,  # (samples H, samples W)
    colors: u8_2,  # (N, 3)
    background: u8_1,  # (3,)
    samples: ti.i32,
    # outputs
    image: u8_3,  # (H, W, 3)
):
    for y, x, k in image:
        count = samples * samples
        total = 0
        for s in range(count):
            key = keys[y * samples + s // samples, x * samples + s % samples]
            value = ti.cast(background[k], ti.i32)
            if key != ti.i64(FAR):
                value = ti.cast(colors[ti.cast(key & 0x7FFFFFFF, ti.i32), k], ti.i32)
            total += value
        image[y, x, k] = ti.cast((2 * total + count) // (2 * count), ti.u8)


@primitive
def shade(
    keys: np.ndarray, colors: np.ndarray, background: np.ndarray, samples: int, image: np.ndarray
) -> None:
    """Average the colours of the samples of each pixel; one thread per channel of a pixel."""
    _shade(keys, colors, background, samples, image)
