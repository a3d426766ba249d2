"""Images without the bend of a lens, in Taichi: the map and the sample in one kernel.

A pixel of the result has the ray ``(x, y, z) = M (column, row, 1)`` of the old camera. Its lens
bends (x, y) / z by Brown's polynomial (cvkern/geometry/cameras/lens.py) [D. Brown, "Close-range
camera calibration", Photogrammetric Engineering 37(8), 1971], and the four pixels around that place
are weighed linearly, for bytes in steps of 1/256 pixel. One thread takes a pixel.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.geometry import LENS_SEGMENT
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._rounding import product, quotient

any_3 = ti.types.ndarray(ndim=3)  # u8 or f32
f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
vec3 = ti.types.vector(3, ti.f32)


@primitive
def sample(src: np.ndarray, numbers: np.ndarray, cval: float, dst: np.ndarray) -> None:
    """Sample an image (H, W, C) where rays of another camera are seen; one thread a pixel.

    `numbers` are a matrix (9), from (column, row, 1) of the result to rays of the old camera; then
    fx, fy, cx, cy, k1, k2, p1, p2, k3 of that; the square of the radius beyond which the lens
    shows nothing; and 1 where the places of `LENS_SEGMENT` pixels of a row may be a parabola.
    """
    _sample(src, numbers, dst.dtype == np.uint8, cval, 0, dst)


@ti.func
def _ray(m: ti.template(), row: ti.i32, i: ti.f32, j: ti.f32, zero: ti.i32) -> ti.f32:
    """Return one row of the matrix times (j, i, 1)."""
    return product(m[3 * row], j, zero) + (product(m[3 * row + 1], i, zero) + m[3 * row + 2])


@ti.func
def _seen(m: ti.template(), row: ti.i32, column: ti.i32, zero: ti.i32) -> vec3:
    """Return the column and row of the place where a pixel is seen, and 1; or 0 where it is not."""
    i = ti.cast(row, ti.f32)
    j = ti.cast(column, ti.f32)
    z = _ray(m, 2, i, j, zero)
    w = quotient(1.0, z, zero)
    x = product(_ray(m, 0, i, j, zero), w, zero)
    y = product(_ray(m, 1, i, j, zero), w, zero)
    xx = product(x, x, zero)
    yy = product(y, y, zero)
    xy = product(x, y, zero)
    r2 = xx + yy
    radial = product(r2, m[17], zero) + m[14]
    radial = product(r2, radial, zero) + m[13]
    radial = product(r2, radial, zero) + 1.0
    p1 = m[15]
    p2 = m[16]
    bend_x = 2.0 * product(p1, xy, zero) + product(p2, r2 + 2.0 * xx, zero)
    bend_y = product(p1, r2 + 2.0 * yy, zero) + 2.0 * product(p2, xy, zero)
    u = product(m[9], product(x, radial, zero) + bend_x, zero) + m[11]
    v = product(m[10], product(y, radial, zero) + bend_y, zero) + m[12]
    return vec3(u, v, ti.select(z > 0.0 and r2 < m[18], 1.0, 0.0))


@ti.func
def _parabola(u0: ti.f32, u1: ti.f32, u2: ti.f32, t: ti.f32, zero: ti.i32) -> ti.f32:
    """Return the value at t of the parabola through 0, half a segment and a segment."""
    one = u1 - u0
    two = u2 - u1
    a = product(product(3.0, one, zero) - two, 1.0 / LENS_SEGMENT, zero)
    b = product(two - one, 2.0 / LENS_SEGMENT**2, zero)
    return u0 + product(t, a + product(t, b, zero), zero)


@ti.func
def _place(m: ti.template(), row: ti.i32, column: ti.i32, zero: ti.i32) -> vec3:
    """Return the place that `_seen` finds, or one on a parabola between places that it finds."""
    t = column % LENS_SEGMENT
    begin = column - t
    found = vec3(0.0, 0.0, 0.0)
    first = vec3(0.0, 0.0, 0.0)
    last = vec3(0.0, 0.0, 0.0)
    if m[19] > 0.0:
        first = _seen(m, row, begin, zero)
        last = _seen(m, row, begin + LENS_SEGMENT, zero)
    if first[2] > 0.0 and last[2] > 0.0:
        middle = _seen(m, row, begin + LENS_SEGMENT // 2, zero)
        share = ti.cast(t, ti.f32)
        u = _parabola(first[0], middle[0], last[0], share, zero)
        v = _parabola(first[1], middle[1], last[1], share, zero)
        found = vec3(u, v, 1.0)
    else:
        found = _seen(m, row, column, zero)
    return found


@ti.kernel
def _sample(
    src: any_3,  # (H, W, C)
    numbers: f32_1,  # (20,)
    byte: ti.template(),
    cval: ti.f32,
    zero: ti.i32,
    # outputs
    dst: any_3,  # (H', W', C)
):
    for row, column in ti.ndrange(dst.shape[0], dst.shape[1]):
        height = src.shape[0]
        width = src.shape[1]
        place = _place(numbers, row, column, zero)
        u = place[0]
        v = place[1]
        inside = place[2] > 0.0 and u >= 0.0 and v >= 0.0
        if inside and u <= ti.cast(width - 1, ti.f32) and v <= ti.cast(height - 1, ti.f32):
            if ti.static(byte):
                ix = ti.cast(product(u, 256.0, zero) + 0.5, ti.i32)
                iy = ti.cast(product(v, 256.0, zero) + 0.5, ti.i32)
                x0 = ti.min(ix >> 8, width - 2)
                y0 = ti.min(iy >> 8, height - 2)
                wx = ix - (x0 << 8)
                wy = iy - (y0 << 8)
                for c in range(dst.shape[2]):
                    a = ti.cast(src[y0, x0, c], ti.i32)
                    b = ti.cast(src[y0 + 1, x0, c], ti.i32)
                    top = (a << 8) + wx * (ti.cast(src[y0, x0 + 1, c], ti.i32) - a)
                    low = (b << 8) + wx * (ti.cast(src[y0 + 1, x0 + 1, c], ti.i32) - b)
                    dst[row, column, c] = ti.cast(
                        ((top << 8) + wy * (low - top) + 32768) >> 16, ti.u8
                    )
            else:
                x0 = ti.min(ti.cast(u, ti.i32), width - 2)
                y0 = ti.min(ti.cast(v, ti.i32), height - 2)
                fx = u - ti.cast(x0, ti.f32)
                fy = v - ti.cast(y0, ti.f32)
                for c in range(dst.shape[2]):
                    a = src[y0, x0, c]
                    b = src[y0 + 1, x0, c]
                    top = a + product(fx, src[y0, x0 + 1, c] - a, zero)
                    low = b + product(fx, src[y0 + 1, x0 + 1, c] - b, zero)
                    dst[row, column, c] = top + product(fy, low - top, zero)
        else:
            for c in range(dst.shape[2]):
                if ti.static(byte):
                    limit = ti.min(ti.max(cval, 0.0), 255.0) + 0.5
                    dst[row, column, c] = ti.cast(ti.cast(limit, ti.i32), ti.u8)
                else:
                    dst[row, column, c] = cval
