"""Projection of images onto the surface of a panorama, in Warp: map and sample in one kernel.

Tables of columns (a, b) and rows (p, q) give the direction (a p, q, b p) of a pixel on any surface.
A camera is ten numbers: a matrix that maps the direction to a pixel (x, y, 1) of the image, up to
scale, and the number k of the lens, which moves a pixel at p from the middle of the image to
p (1 + k |p|^2). One thread computes one pixel of the panorama.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.codes import panorama as codes
from cvkern.kernels.warp._launch import launch_each

OPTIONS = {"enable_backward": False, "fuse_fp": False}
wp.set_module_options(OPTIONS)

NEAR = wp.constant(wp.float64(codes.NEAR))
NOBODY = wp.constant(codes.NOBODY)


def project(
    src: wp.array,
    camera: wp.array,
    columns: wp.array,
    rows: wp.array,
    gains: wp.array,
    values: wp.array,
    weights: wp.array,
) -> None:
    """Sample an image times its gains, and write its weight; one thread a pixel.

    The rim is repeated outside the image. The weight is 1 in the middle of the image, falls towards
    its sides, and is 0 outside.
    """
    inputs = [src, camera, columns, rows, gains]
    launch_each(
        project_kernel(src.dtype), weights.size, weights.size * 16, inputs, [values, weights]
    )


def claim(
    cameras: wp.array,
    sides: wp.array,
    names: wp.array,
    columns: wp.array,
    rows: wp.array,
    coarse: wp.array,
    coarse_columns: wp.array,
    coarse_rows: wp.array,
    labels: wp.array,
) -> None:
    """Label each pixel with the coarse label if that image covers it, else by the largest weight.

    Only the images `names` take part; among equal weights the first wins. One thread a pixel.
    """
    inputs = [cameras, sides, names, columns, rows, coarse, coarse_columns, coarse_rows]
    launch_each(_claim, labels.size, labels.size * 8, inputs, [labels])


def mark(labels: wp.array, name: int, top: int, left: int, mask: wp.array) -> None:
    """Write 1 where a label of a part is `name`, else 0; one thread a pixel."""
    launch_each(_mark, mask.size, mask.size, [labels, name, top, left], [mask])


def bound(labels: wp.array, bounds: wp.array) -> None:
    """Extend the first and last row and column of each label; one thread a pixel.

    On the CPU one thread takes all pixels.
    """
    launch_each(_bound, labels.size, 1, [labels], [bounds])


@wp.func
def place(
    m: wp.array2d[wp.float64], n: int, ab: wp.vec2d, pq: wp.vec2d, height: int, width: int
) -> wp.vec3d:
    """Return x and y in image n, and the depth: -1 where the lens would turn back."""
    dx = ab[0] * pq[0]
    dy = pq[1]
    dz = ab[1] * pq[0]
    depth = m[n, 6] * dx + m[n, 7] * dy + m[n, 8] * dz
    safe = wp.max(depth, NEAR)
    x = (m[n, 0] * dx + m[n, 1] * dy + m[n, 2] * dz) / safe
    y = (m[n, 3] * dx + m[n, 4] * dy + m[n, 5] * dz) / safe
    k = m[n, 9]
    if k != wp.float64(0.0):
        one = wp.float64(1.0)
        half = wp.float64(0.5)
        middle_x = half * wp.float64(width - 1)
        middle_y = half * wp.float64(height - 1)
        dx = x - middle_x
        dy = y - middle_y
        bent = k * (dx * dx + dy * dy)
        if one + wp.float64(3.0) * bent > wp.float64(0.0):
            x = middle_x + dx * (one + bent)
            y = middle_y + dy * (one + bent)
        else:
            depth = -one
    return wp.vec3d(x, y, depth)


@wp.func
def weight_of(at: wp.vec3d, height: int, width: int) -> float:
    """Return the weight of an image at a place: 0 outside."""
    one = wp.float64(1.0)
    half = wp.float64(0.5)
    two = wp.float64(2.0)
    across = one - wp.abs(two * (at[0] + half) / wp.float64(width) - one)
    down = one - wp.abs(two * (at[1] + half) / wp.float64(height) - one)
    zero = wp.float64(0.0)
    if at[2] <= NEAR or across <= zero or down <= zero:
        return 0.0
    return wp.float32(across * down)


@lru_cache
def project_kernel(scalar: Any) -> wp.Kernel:
    """Make the kernel that samples arrays of `scalar`."""

    @wp.kernel(module="unique", module_options=OPTIONS)
    def project_pixels(
        stride: int,
        first: int,
        last: int,
        src: wp.array3d[scalar],  # (H, W, C)
        camera: wp.array2d[wp.float64],  # (1, 10)
        columns: wp.array2d[wp.float64],  # (w, 2)
        rows: wp.array2d[wp.float64],  # (h, 2)
        gains: wp.array[float],  # (c,)
        # outputs
        values: wp.array3d[float],  # (c, h, w)
        weights: wp.array2d[float],  # (h, w)
    ):
        width = weights.shape[1]
        zero = wp.float64(0.0)
        for item in range(first + wp.tid(), last, stride):
            i = item // width
            j = item - i * width
            ab = wp.vec2d(columns[j, 0], columns[j, 1])
            pq = wp.vec2d(rows[i, 0], rows[i, 1])
            at = place(camera, 0, ab, pq, src.shape[0], src.shape[1])
            weights[i, j] = weight_of(at, src.shape[0], src.shape[1])
            x = wp.clamp(at[0], zero, wp.float64(src.shape[1] - 1))
            y = wp.clamp(at[1], zero, wp.float64(src.shape[0] - 1))
            x0 = int(wp.floor(x))
            y0 = int(wp.floor(y))
            x1 = wp.min(x0 + 1, src.shape[1] - 1)
            y1 = wp.min(y0 + 1, src.shape[0] - 1)
            fx = wp.float32(x - wp.float64(x0))
            fy = wp.float32(y - wp.float64(y0))
            for c in range(values.shape[0]):
                k = wp.min(c, src.shape[2] - 1)
                upper = (1.0 - fx) * float(src[y0, x0, k]) + fx * float(src[y0, x1, k])
                lower = (1.0 - fx) * float(src[y1, x0, k]) + fx * float(src[y1, x1, k])
                values[c, i, j] = gains[c] * ((1.0 - fy) * upper + fy * lower)

    return project_pixels


@wp.kernel
def _claim(
    stride: int,
    first: int,
    last: int,
    cameras: wp.array2d[wp.float64],  # (N, 10)
    sides: wp.array2d[int],  # (N, 2), heights and widths
    names: wp.array[int],  # (K,)
    columns: wp.array2d[wp.float64],  # (w, 2)
    rows: wp.array2d[wp.float64],  # (h, 2)
    coarse: wp.array2d[int],  # (H', W')
    coarse_columns: wp.array[int],  # (w,)
    coarse_rows: wp.array[int],  # (h,)
    # outputs
    labels: wp.array2d[int],  # (h, w)
):
    width = labels.shape[1]
    for item in range(first + wp.tid(), last, stride):
        i = item // width
        j = item - i * width
        ab = wp.vec2d(columns[j, 0], columns[j, 1])
        pq = wp.vec2d(rows[i, 0], rows[i, 1])
        found = coarse[coarse_rows[i], coarse_columns[j]]
        good = bool(False)
        if found >= 0:
            height = sides[found, 0]
            wide = sides[found, 1]
            at = place(cameras, found, ab, pq, height, wide)
            good = weight_of(at, height, wide) > 0.0
        if not good:
            found = int(NOBODY)
            most = float(0.0)
            for k in range(names.shape[0]):
                n = names[k]
                at = place(cameras, n, ab, pq, sides[n, 0], sides[n, 1])
                weight = weight_of(at, sides[n, 0], sides[n, 1])
                if weight > most:
                    most = weight
                    found = n
        labels[i, j] = found


@wp.kernel
def _mark(
    stride: int,
    first: int,
    last: int,
    labels: wp.array2d[int],  # (H, W)
    name: int,
    top: int,
    left: int,
    # outputs
    mask: wp.array2d[float],  # (h, w)
):
    width = mask.shape[1]
    for item in range(first + wp.tid(), last, stride):
        i = item // width
        j = item - i * width
        mask[i, j] = wp.where(labels[top + i, left + j] == name, 1.0, 0.0)


@wp.kernel
def _bound(
    stride: int,
    first: int,
    last: int,
    labels: wp.array2d[int],  # (h, w)
    # outputs
    bounds: wp.array2d[int],  # (N, 4)
):
    width = labels.shape[1]
    for item in range(first + wp.tid(), last, stride):
        i = item // width
        j = item - i * width
        n = labels[i, j]
        if n >= 0:
            if i < bounds[n, 0]:
                wp.atomic_min(bounds, n, 0, i)
            if j < bounds[n, 1]:
                wp.atomic_min(bounds, n, 1, j)
            if i > bounds[n, 2]:
                wp.atomic_max(bounds, n, 2, i)
            if j > bounds[n, 3]:
                wp.atomic_max(bounds, n, 3, j)
