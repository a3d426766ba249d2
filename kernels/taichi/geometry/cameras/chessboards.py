"""Chessboards in Taichi: a smaller grey picture, its saddles, and corners within the pixel.

The inner corners of a board are saddles of the smoothed picture, where ``I_yy I_xx - I_xy^2`` is
negative. A corner p is fitted to the pixels q around it by least squares with
``c + A E(n_0 . (q - p) / s) E(n_1 . (q - p) / s) + g . q``: two edges with the normals n_0 and n_1
and the blur s, where ``E(t) = erf(t / sqrt 2)``, under a light with the slope g. The page of this
family in docs/ says why. One thread takes a block, a pixel, or a corner.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.geometry import (
    CORNER_FARTHEST,
    CORNER_SHARE,
    CORNER_STEPS,
    CORNER_STILL,
    EDGE_ENTRIES,
    EDGE_REACH,
    LUMA,
)
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._rounding import product, quotient

any_3 = ti.types.ndarray(ndim=3)  # u8 or f32
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f64_2 = ti.types.ndarray(dtype=ti.f64, ndim=2)
vec2 = ti.types.vector(2, ti.f32)
vec4 = ti.types.vector(4, ti.f64)
vec5 = ti.types.vector(5, ti.f64)
mat44 = ti.types.matrix(4, 4, ti.f64)
mat55 = ti.types.matrix(5, 5, ti.f64)
RED, GREEN, BLUE = LUMA


@primitive
def shrink(src: np.ndarray, dst: np.ndarray) -> None:
    """Average blocks of a picture (H, W, C), in grey; one thread a block."""
    _shrink(src, src.shape[0] // dst.shape[0], 0, dst)


@primitive
def saddles(src: np.ndarray, dst: np.ndarray) -> None:
    """Measure how much of a saddle a smooth picture is; one thread a pixel."""
    _saddles(src, 0, dst)


@primitive
def refine(src: np.ndarray, table: np.ndarray, starts: np.ndarray, places: np.ndarray) -> None:
    """Fit two crossing edges to the pixels about each start (y, x, edges); one thread a corner."""
    _refine(src, table, starts, 0, places)


@ti.func
def _light(src: ti.template(), y: ti.i32, x: ti.i32, zero: ti.i32) -> ti.f32:
    """Return a pixel in grey."""
    found = ti.cast(src[y, x, 0], ti.f32)
    if src.shape[2] >= 3:
        red = product(found, RED, zero)
        green = product(ti.cast(src[y, x, 1], ti.f32), GREEN, zero)
        found = (red + green) + product(ti.cast(src[y, x, 2], ti.f32), BLUE, zero)
    return found


@ti.kernel
def _shrink(
    src: any_3,  # (H, W, C)
    step: ti.i32,
    zero: ti.i32,
    # outputs
    dst: f32_2,  # (H / step, W / step)
):
    for i, j in dst:
        total = 0.0
        for y in range(step * i, step * i + step):
            for x in range(step * j, step * j + step):
                total += _light(src, y, x, zero)
        dst[i, j] = quotient(total, ti.cast(step * step, ti.f32), zero)


@ti.kernel
def _saddles(
    src: f32_2,
    zero: ti.i32,
    # outputs
    dst: f32_2,
):
    for y, x in dst:
        found = 0.0
        if y > 0 and x > 0 and y < src.shape[0] - 1 and x < src.shape[1] - 1:
            twice = 2.0 * src[y, x]
            xx = (src[y, x - 1] + src[y, x + 1]) - twice
            yy = (src[y - 1, x] + src[y + 1, x]) - twice
            xy = (src[y - 1, x - 1] + src[y + 1, x + 1]) - (src[y - 1, x + 1] + src[y + 1, x - 1])
            mixed = product(0.0625, product(xy, xy, zero), zero)
            found = ti.max(mixed - product(xx, yy, zero), 0.0)
        dst[y, x] = found


@ti.func
def _edge(table: ti.template(), t: ti.f32) -> vec2:
    """Return the error function of t / sqrt(2), and its slope, from a table."""
    place = ti.min(ti.abs(t), EDGE_REACH) * ((EDGE_ENTRIES - 1) / EDGE_REACH)
    n = ti.min(ti.cast(place, ti.i32), EDGE_ENTRIES - 2)
    share = place - n
    value = table[n, 0] + share * (table[n + 1, 0] - table[n, 0])
    slope = table[n, 1] + share * (table[n + 1, 1] - table[n, 1])
    return vec2(ti.select(t < 0.0, -value, value), slope)


@ti.func
def _solved(a: ti.template(), x: ti.template(), size: ti.template()):
    """Solve positive definite equations of which the lower half is given, in place."""
    for k in ti.static(range(size)):
        for i in ti.static(range(k + 1, size)):
            f = a[i, k] / a[k, k]
            for j in ti.static(range(k + 1, i + 1)):
                a[i, j] -= f * a[j, k]
            x[i] -= f * x[k]
    for m in ti.static(range(size)):
        for j in ti.static(range(size - m, size)):
            x[size - 1 - m] -= a[j, size - 1 - m] * x[j]
        x[size - 1 - m] /= a[size - 1 - m, size - 1 - m]


@ti.func
def _rotated(along: vec2, angle: ti.f32) -> vec2:
    """Turn a direction by a small angle."""
    turned = along + angle * vec2(-along[1], along[0])
    return turned / turned.norm()


@ti.func
def _limited(value: ti.f64, most: ti.f32) -> ti.f32:
    """Return a step that is not too long."""
    return ti.min(ti.max(ti.cast(value, ti.f32), -most), most)


@ti.kernel
def _refine(
    src: any_3,  # (H, W, C)
    table: f32_2,  # (ENTRIES, 2)
    starts: f32_2,  # (N, 7): y, x, an edge, the other edge, blur
    zero: ti.i32,
    # outputs
    places: f64_2,  # (N, 5): y, x, contrast, residual, blur
):
    # The squares of what c + A E(d0 / s) E(d1 / s) + g (p - start) leaves are made least. The
    # derivatives by the place and by the slope g of the light are odd about the corner, all others
    # even: over a window about it the two groups hardly meet, and are solved apart.
    for n in range(starts.shape[0]):
        cy = ti.cast(ti.floor(starts[n, 0] + 0.5), ti.i32)
        cx = ti.cast(ti.floor(starts[n, 1] + 0.5), ti.i32)
        p = vec2(starts[n, 1] - cx, starts[n, 0] - cy)  # x, y from that pixel
        a = vec2(starts[n, 3], starts[n, 2])
        b = vec2(starts[n, 5], starts[n, 4])
        s = starts[n, 6]
        det = a[0] * b[1] - a[1] * b[0]
        far_a = ti.min(CORNER_SHARE, CORNER_FARTHEST / a.norm())
        far_b = ti.min(CORNER_SHARE, CORNER_FARTHEST / b.norm())
        reach_y = ti.cast(far_a * ti.abs(a[1]) + far_b * ti.abs(b[1]), ti.i32) + 1
        reach_x = ti.cast(far_a * ti.abs(a[0]) + far_b * ti.abs(b[0]), ti.i32) + 1
        start = p
        edge_a = a / a.norm()
        edge_b = b / b.norm()
        slope = vec2(0.0, 0.0)
        height = 0.0
        middle = 0.0
        residual = ti.cast(0.0, ti.f64)
        step = 0
        while step <= CORNER_STEPS:
            odd = mat44(0.0)
            even = mat55(0.0)
            move = vec4(0.0)
            change = vec5(0.0)
            squares = ti.cast(0.0, ti.f64)
            count = 0
            for y in range(ti.max(cy - reach_y, 0), ti.min(cy + reach_y + 1, src.shape[0])):
                for x in range(ti.max(cx - reach_x, 0), ti.min(cx + reach_x + 1, src.shape[1])):
                    q = vec2(x - cx, y - cy) - start
                    u = (q[0] * b[1] - q[1] * b[0]) / det
                    v = (a[0] * q[1] - a[1] * q[0]) / det
                    if ti.abs(u) <= far_a and ti.abs(v) <= far_b:
                        d = vec2(x - cx, y - cy) - p
                        across_a = edge_a[0] * d[1] - edge_a[1] * d[0]
                        across_b = edge_b[0] * d[1] - edge_b[1] * d[0]
                        one = _edge(table, across_a / s)
                        two = _edge(table, across_b / s)
                        both = one[0] * two[0]
                        shown = middle + height * both + (slope[0] * q[0] + slope[1] * q[1])
                        off = ti.cast(_light(src, y, x, zero) - shown, ti.f64)
                        da = height * one[1] * two[0] / s
                        db = height * one[0] * two[1] / s
                        along_a = edge_a[0] * d[0] + edge_a[1] * d[1]
                        along_b = edge_b[0] * d[0] + edge_b[1] * d[1]
                        f = vec4(
                            da * edge_a[1] + db * edge_b[1],
                            -da * edge_a[0] - db * edge_b[0],
                            q[0],
                            q[1],
                        )
                        g = vec5(
                            both,
                            1.0,
                            -da * along_a,
                            -db * along_b,
                            -(da * across_a + db * across_b) / s,
                        )
                        for i in ti.static(range(4)):
                            move[i] += f[i] * off
                            for j in ti.static(range(i + 1)):
                                odd[i, j] += f[i] * f[j]
                        for i in ti.static(range(5)):
                            change[i] += g[i] * off
                            for j in ti.static(range(i + 1)):
                                even[i, j] += g[i] * g[j]
                        squares += off * off
                        count += 1
            if step == 0:  # the height alone, which all other derivatives have as a factor
                scale = even[0, 0] * even[1, 1] - even[1, 0] * even[1, 0]
                height = ti.cast((even[1, 1] * change[0] - even[1, 0] * change[1]) / scale, ti.f32)
                middle = ti.cast((even[0, 0] * change[1] - even[1, 0] * change[0]) / scale, ti.f32)
            else:
                _solved(odd, move, 4)
                _solved(even, change, 5)
                p += vec2(_limited(move[0], 1.0), _limited(move[1], 1.0))
                slope += vec2(ti.cast(move[2], ti.f32), ti.cast(move[3], ti.f32))
                height += ti.cast(change[0], ti.f32)
                middle += ti.cast(change[1], ti.f32)
                edge_a = _rotated(edge_a, _limited(change[2], 0.2))
                edge_b = _rotated(edge_b, _limited(change[3], 0.2))
                s += ti.min(ti.max(ti.cast(change[4], ti.f32), -0.5 * s), s)
                s = ti.min(ti.max(s, 0.25), 12.0)
                # The next step would be far less than this one.
                still = ti.f64(CORNER_STILL)
                if ti.abs(move[0]) < still and ti.abs(move[1]) < still:
                    step = CORNER_STEPS
            residual = ti.sqrt(squares / ti.max(count - 9, 1))
            step += 1
        places[n, 0] = ti.cast(cy, ti.f64) + ti.cast(p[1], ti.f64)
        places[n, 1] = ti.cast(cx, ti.f64) + ti.cast(p[0], ti.f64)
        places[n, 2] = 2.0 * ti.cast(height, ti.f64)
        places[n, 3] = residual
        places[n, 4] = ti.cast(s, ti.f64)
