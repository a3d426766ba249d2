"""Projection of images onto the surface of a panorama, in Taichi: map and sample in one kernel.

Tables of columns (a, b) and rows (p, q) give the direction (a p, q, b p) of a pixel on any surface.
A camera is ten numbers: a matrix that maps the direction to a pixel (x, y, 1) of the image, up to
scale, and the number k of the lens, which moves a pixel at p from the middle of the image to
p (1 + k |p|^2). One thread computes one pixel of the panorama.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.panorama import NEAR, NOBODY
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._rounding import product, wide_product

any_3 = ti.types.ndarray(ndim=3)  # u8 or f32
f64_2 = ti.types.ndarray(dtype=ti.f64, ndim=2)
f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)


@primitive
def project(
    src: np.ndarray,
    camera: np.ndarray,
    columns: np.ndarray,
    rows: np.ndarray,
    gains: np.ndarray,
    values: np.ndarray,
    weights: np.ndarray,
) -> None:
    """Sample an image times its gains, and write its weight; one thread a pixel.

    The rim is repeated outside the image. The weight is 1 in the middle of the image, falls towards
    its sides, and is 0 outside.
    """
    _project(src, camera, columns, rows, gains, 0, values, weights)


@primitive
def claim(
    cameras: np.ndarray,
    sides: np.ndarray,
    names: np.ndarray,
    columns: np.ndarray,
    rows: np.ndarray,
    coarse: np.ndarray,
    coarse_columns: np.ndarray,
    coarse_rows: np.ndarray,
    labels: np.ndarray,
) -> None:
    """Label each pixel with the coarse label if that image covers it, else by the largest weight.

    Only the images `names` take part; among equal weights the first wins. One thread a pixel.
    """
    _claim(cameras, sides, names, columns, rows, coarse, coarse_columns, coarse_rows, 0, labels)


@primitive
def mark(labels: np.ndarray, name: int, top: int, left: int, mask: np.ndarray) -> None:
    """Write 1 where a label of a part is `name`, else 0; one thread a pixel."""
    _mark(labels, name, top, left, mask)


@primitive
def bound(labels: np.ndarray, bounds: np.ndarray) -> None:
    """Extend the first and last row and column of each label; one thread a pixel."""
    _bound(labels, bounds)


@ti.func
def _row_of(m: ti.template(), n: ti.i32, row: ti.i32, d: ti.template(), zero: ti.i32) -> ti.f64:
    """Return one row of the matrix of image n times a direction."""
    a = wide_product(m[n, 3 * row], d[0], zero) + wide_product(m[n, 3 * row + 1], d[1], zero)
    return a + wide_product(m[n, 3 * row + 2], d[2], zero)


@ti.func
def _place(
    m: ti.template(),
    n: ti.i32,
    columns: ti.template(),
    rows: ti.template(),
    i: ti.i32,
    j: ti.i32,
    height: ti.i32,
    width: ti.i32,
    zero: ti.i32,
):
    """Return x and y in image n, and the depth: -1 where the lens would turn back."""
    dx = wide_product(columns[j, 0], rows[i, 0], zero)
    dz = wide_product(columns[j, 1], rows[i, 0], zero)
    d = ti.Vector([dx, rows[i, 1], dz], dt=ti.f64)
    depth = _row_of(m, n, 2, d, zero)
    safe = ti.max(depth, ti.f64(NEAR))
    x = _row_of(m, n, 0, d, zero) / safe
    y = _row_of(m, n, 1, d, zero) / safe
    k = m[n, 9]
    if k != 0.0:
        half = ti.cast(0.5, ti.f64)
        middle_x = wide_product(half, ti.cast(width - 1, ti.f64), zero)
        middle_y = wide_product(half, ti.cast(height - 1, ti.f64), zero)
        p = x - middle_x
        q = y - middle_y
        bent = wide_product(k, wide_product(p, p, zero) + wide_product(q, q, zero), zero)
        if 1.0 + wide_product(ti.cast(3.0, ti.f64), bent, zero) > 0.0:
            x = middle_x + wide_product(p, 1.0 + bent, zero)
            y = middle_y + wide_product(q, 1.0 + bent, zero)
        else:
            depth = -1.0
    return ti.Vector([x, y, depth], dt=ti.f64)


@ti.func
def _weight(at: ti.template(), height: ti.i32, width: ti.i32, zero: ti.i32) -> ti.f32:
    """Return the weight of an image at a place: 0 outside."""
    weight = 0.0
    half = ti.cast(0.5, ti.f64)
    two = ti.cast(2.0, ti.f64)
    across = 1.0 - ti.abs(wide_product(two, at[0] + half, zero) / width - 1.0)
    down = 1.0 - ti.abs(wide_product(two, at[1] + half, zero) / height - 1.0)
    if at[2] > ti.f64(NEAR) and across > 0.0 and down > 0.0:
        weight = ti.cast(across * down, ti.f32)
    return weight


@ti.kernel
def _project(
    src: any_3,  # (H, W, C)
    camera: f64_2,  # (1, 10)
    columns: f64_2,  # (w, 2)
    rows: f64_2,  # (h, 2)
    gains: f32_1,  # (c,)
    zero: ti.i32,
    # outputs
    values: f32_3,  # (c, h, w)
    weights: f32_2,  # (h, w)
):
    for i, j in ti.ndrange(weights.shape[0], weights.shape[1]):
        at = _place(camera, 0, columns, rows, i, j, src.shape[0], src.shape[1], zero)
        weights[i, j] = _weight(at, src.shape[0], src.shape[1], zero)
        x = ti.max(ti.min(at[0], ti.cast(src.shape[1] - 1, ti.f64)), ti.cast(0.0, ti.f64))
        y = ti.max(ti.min(at[1], ti.cast(src.shape[0] - 1, ti.f64)), ti.cast(0.0, ti.f64))
        x0 = ti.cast(ti.floor(x), ti.i32)
        y0 = ti.cast(ti.floor(y), ti.i32)
        x1 = ti.min(x0 + 1, src.shape[1] - 1)
        y1 = ti.min(y0 + 1, src.shape[0] - 1)
        fx = ti.cast(x - ti.cast(x0, ti.f64), ti.f32)
        fy = ti.cast(y - ti.cast(y0, ti.f64), ti.f32)
        for c in range(values.shape[0]):
            k = ti.min(c, src.shape[2] - 1)
            upper = product(1.0 - fx, ti.cast(src[y0, x0, k], ti.f32), zero) + product(
                fx, ti.cast(src[y0, x1, k], ti.f32), zero
            )
            lower = product(1.0 - fx, ti.cast(src[y1, x0, k], ti.f32), zero) + product(
                fx, ti.cast(src[y1, x1, k], ti.f32), zero
            )
            values[c, i, j] = gains[c] * (product(1.0 - fy, upper, zero) + product(fy, lower, zero))


@ti.kernel
def _claim(
    cameras: f64_2,  # (N, 10)
    sides: i32_2,  # (N, 2), heights and widths
    names: i32_1,  # (K,)
    columns: f64_2,  # (w, 2)
    rows: f64_2,  # (h, 2)
    coarse: i32_2,  # (H', W')
    coarse_columns: i32_1,  # (w,)
    coarse_rows: i32_1,  # (h,)
    zero: ti.i32,
    # outputs
    labels: i32_2,  # (h, w)
):
    for i, j in ti.ndrange(labels.shape[0], labels.shape[1]):
        found = coarse[coarse_rows[i], coarse_columns[j]]
        good = False
        if found >= 0:
            at = _place(cameras, found, columns, rows, i, j, sides[found, 0], sides[found, 1], zero)
            good = _weight(at, sides[found, 0], sides[found, 1], zero) > 0.0
        if not good:
            found = NOBODY
            most = 0.0
            for k in range(names.shape[0]):
                n = names[k]
                at = _place(cameras, n, columns, rows, i, j, sides[n, 0], sides[n, 1], zero)
                weight = _weight(at, sides[n, 0], sides[n, 1], zero)
                if weight > most:
                    most = weight
                    found = n
        labels[i, j] = found


@ti.kernel
def _mark(
    labels: i32_2,  # (H, W)
    name: ti.i32,
    top: ti.i32,
    left: ti.i32,
    # outputs
    mask: f32_2,  # (h, w)
):
    for i, j in mask:
        mask[i, j] = ti.select(labels[top + i, left + j] == name, 1.0, 0.0)


@ti.kernel
def _bound(
    labels: i32_2,  # (h, w)
    # outputs
    bounds: i32_2,  # (N, 4)
):
    for i, j in labels:
        n = labels[i, j]
        if n >= 0:
            if i < bounds[n, 0]:
                ti.atomic_min(bounds[n, 0], i)
            if j < bounds[n, 1]:
                ti.atomic_min(bounds[n, 1], j)
            if i > bounds[n, 2]:
                ti.atomic_max(bounds[n, 2], i)
            if j > bounds[n, 3]:
                ti.atomic_max(bounds[n, 3], j)
