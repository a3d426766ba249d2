"""Chessboards in Warp: a smaller grey picture, its saddles, and corners within the pixel.

The inner corners of a board are saddles of the smoothed picture, where ``I_yy I_xx - I_xy^2`` is
negative. A corner p is fitted to the pixels q around it by least squares with
``c + A E(n_0 . (q - p) / s) E(n_1 . (q - p) / s) + g . q``: two edges with the normals n_0 and n_1
and the blur s, where ``E(t) = erf(t / sqrt 2)``, under a light with the slope g. The page of this
family in docs/ says why. One thread takes a block, a pixel, or a corner; on the CPU, slabs of them.
"""

from typing import Any

import warp as wp

from cvkern.kernels.codes.geometry import (
    CORNER_FARTHEST,
    CORNER_SHARE,
    CORNER_STEPS,
    CORNER_STILL,
    EDGE_ENTRIES,
    EDGE_REACH,
    LUMA,
)
from cvkern.kernels.warp._launch import launch_each

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

RED, GREEN, BLUE = (wp.constant(weight) for weight in LUMA)
ENTRIES = wp.constant(EDGE_ENTRIES)
REACH = wp.constant(EDGE_REACH)
STEPS = wp.constant(CORNER_STEPS)
SHARE = wp.constant(CORNER_SHARE)
FARTHEST = wp.constant(CORNER_FARTHEST)
STILL = wp.constant(wp.float64(CORNER_STILL))
mat44 = wp.types.matrix((4, 4), wp.float64)
mat55 = wp.types.matrix((5, 5), wp.float64)
vec4 = wp.types.vector(4, wp.float64)
vec5 = wp.types.vector(5, wp.float64)


def shrink(src: wp.array, dst: wp.array) -> None:
    """Average blocks of a picture (H, W, C), in grey; one thread a block."""
    step = src.shape[0] // dst.shape[0]
    launch_each(SHRINK[src.dtype], dst.size, src.size, [src, step], [dst])


def saddles(src: wp.array, dst: wp.array) -> None:
    """Measure how much of a saddle a smooth picture is; one thread a pixel."""
    launch_each(_saddles, dst.size, 4 * dst.size, [src], [dst])


def refine(src: wp.array, table: wp.array, starts: wp.array, places: wp.array) -> None:
    """Fit two crossing edges to the pixels about each start (y, x, edges); one thread a corner."""
    count = places.shape[0]
    launch_each(REFINE[src.dtype], count, 20000 * count, [src, table, starts], [places])


@wp.func
def light(src: wp.array3d[Any], y: int, x: int) -> float:
    """Return a pixel in grey."""
    if src.shape[2] < 3:
        return float(src[y, x, 0])
    return (float(src[y, x, 0]) * RED + float(src[y, x, 1]) * GREEN) + float(src[y, x, 2]) * BLUE


@wp.kernel
def _shrink(
    stride: int,
    first: int,
    last: int,
    src: wp.array3d[Any],  # (H, W, C)
    step: int,
    # outputs
    dst: wp.array2d[float],  # (H / step, W / step)
):
    width = dst.shape[1]
    for item in range(first + wp.tid(), last, stride):
        i = item // width
        j = item - i * width
        total = float(0.0)
        for y in range(step * i, step * i + step):
            for x in range(step * j, step * j + step):
                total += light(src, y, x)
        dst[i, j] = total / float(step * step)


SHRINK = {t: wp.overload(_shrink, {"src": wp.array3d[t]}) for t in (wp.uint8, wp.float32)}


@wp.kernel
def _saddles(
    stride: int,
    first: int,
    last: int,
    src: wp.array2d[float],
    # outputs
    dst: wp.array2d[float],
):
    height = src.shape[0]
    width = src.shape[1]
    for item in range(first + wp.tid(), last, stride):
        y = item // width
        x = item - y * width
        found = float(0.0)
        if y > 0 and x > 0 and y < height - 1 and x < width - 1:
            twice = 2.0 * src[y, x]
            xx = (src[y, x - 1] + src[y, x + 1]) - twice
            yy = (src[y - 1, x] + src[y + 1, x]) - twice
            xy = (src[y - 1, x - 1] + src[y + 1, x + 1]) - (src[y - 1, x + 1] + src[y + 1, x - 1])
            found = wp.max(0.0625 * (xy * xy) - xx * yy, 0.0)
        dst[y, x] = found


@wp.func
def edge(table: wp.array2d[float], t: float) -> wp.vec2:
    """Return the error function of t / sqrt(2), and its slope, from a table."""
    place = wp.min(wp.abs(t), REACH) * (float(ENTRIES - 1) / REACH)
    n = wp.min(int(place), ENTRIES - 2)
    share = place - float(n)
    value = table[n, 0] + share * (table[n + 1, 0] - table[n, 0])
    slope = table[n, 1] + share * (table[n + 1, 1] - table[n, 1])
    return wp.vec2(wp.where(t < 0.0, -value, value), slope)


def _solver(size: int, matrix: Any, vector: Any) -> wp.Function:
    """Make the function that solves so many equations."""

    @wp.func
    def solve(given: matrix, right: vector) -> vector:
        """Solve positive definite equations of which the lower half is given, by elimination."""
        a = matrix()
        x = vector()
        for i in range(size):
            x[i] = right[i]
            for j in range(i + 1):
                a[i, j] = given[i, j]
        for k in range(size):
            for i in range(k + 1, size):
                f = a[i, k] / a[k, k]
                for j in range(k + 1, i + 1):
                    a[i, j] = a[i, j] - f * a[j, k]
                x[i] = x[i] - f * x[k]
        for m in range(size):
            k = size - 1 - m
            rest = x[k]
            for j in range(k + 1, size):
                rest -= a[j, k] * x[j]
            x[k] = rest / a[k, k]
        return x

    return solve


solve4, solve5 = _solver(4, mat44, vec4), _solver(5, mat55, vec5)


@wp.func
def rotated(along: wp.vec2, angle: float) -> wp.vec2:
    """Turn a direction by a small angle."""
    return wp.normalize(along + angle * wp.vec2(-along[1], along[0]))


@wp.kernel
def _refine(
    stride: int,
    first: int,
    last: int,
    src: wp.array3d[Any],  # (H, W, C)
    table: wp.array2d[float],  # (ENTRIES, 2)
    starts: wp.array2d[float],  # (N, 7): y, x, an edge, the other edge, blur
    # outputs
    places: wp.array2d[wp.float64],  # (N, 5): y, x, contrast, residual, blur
):
    """Minimise the squares of what c + A E(d0 / s) E(d1 / s) + g (p - start) leaves.

    The derivatives by the place and by the slope g of the light are odd about the corner, all
    others even: over a window about it the two groups hardly meet, and are solved apart.
    """
    for n in range(first + wp.tid(), last, stride):
        cy = int(wp.floor(starts[n, 0] + 0.5))
        cx = int(wp.floor(starts[n, 1] + 0.5))
        p = wp.vec2(starts[n, 1] - float(cx), starts[n, 0] - float(cy))  # x, y from that pixel
        a = wp.vec2(starts[n, 3], starts[n, 2])
        b = wp.vec2(starts[n, 5], starts[n, 4])
        s = starts[n, 6]
        det = a[0] * b[1] - a[1] * b[0]
        far_a = wp.min(SHARE, FARTHEST / wp.length(a))
        far_b = wp.min(SHARE, FARTHEST / wp.length(b))
        reach_y = int(far_a * wp.abs(a[1]) + far_b * wp.abs(b[1])) + 1
        reach_x = int(far_a * wp.abs(a[0]) + far_b * wp.abs(b[0])) + 1
        top = wp.max(cy - reach_y, 0)
        bottom = wp.min(cy + reach_y, src.shape[0] - 1)
        left = wp.max(cx - reach_x, 0)
        right = wp.min(cx + reach_x, src.shape[1] - 1)
        start = p
        edge_a = wp.normalize(a)
        edge_b = wp.normalize(b)
        slope = wp.vec2(0.0, 0.0)
        height = float(0.0)
        middle = float(0.0)
        residual = wp.float64(0.0)
        step = int(0)
        while step <= STEPS:
            odd = mat44()
            even = mat55()
            odd_right = vec4()
            even_right = vec5()
            squares = wp.float64(0.0)
            count = wp.float64(0.0)
            for y in range(top, bottom + 1):
                for x in range(left, right + 1):
                    q = wp.vec2(float(x - cx), float(y - cy)) - start
                    u = (q[0] * b[1] - q[1] * b[0]) / det
                    v = (a[0] * q[1] - a[1] * q[0]) / det
                    if wp.abs(u) <= far_a and wp.abs(v) <= far_b:
                        d = wp.vec2(float(x - cx), float(y - cy)) - p
                        one = edge(table, (edge_a[0] * d[1] - edge_a[1] * d[0]) / s)
                        two = edge(table, (edge_b[0] * d[1] - edge_b[1] * d[0]) / s)
                        product = one[0] * two[0]
                        shown = middle + height * product + (slope[0] * q[0] + slope[1] * q[1])
                        off = wp.float64(light(src, y, x) - shown)
                        da = height * one[1] * two[0] / s
                        db = height * one[0] * two[1] / s
                        along_a = edge_a[0] * d[0] + edge_a[1] * d[1]
                        along_b = edge_b[0] * d[0] + edge_b[1] * d[1]
                        across_a = edge_a[0] * d[1] - edge_a[1] * d[0]
                        across_b = edge_b[0] * d[1] - edge_b[1] * d[0]
                        f = vec4(
                            wp.float64(da * edge_a[1] + db * edge_b[1]),
                            wp.float64(-da * edge_a[0] - db * edge_b[0]),
                            wp.float64(q[0]),
                            wp.float64(q[1]),
                        )
                        g = vec5(
                            wp.float64(product),
                            wp.float64(1.0),
                            wp.float64(-da * along_a),
                            wp.float64(-db * along_b),
                            wp.float64(-(da * across_a + db * across_b) / s),
                        )
                        for i in range(4):
                            odd_right[i] = odd_right[i] + f[i] * off
                            for j in range(i + 1):
                                odd[i, j] = odd[i, j] + f[i] * f[j]
                        for i in range(5):
                            even_right[i] = even_right[i] + g[i] * off
                            for j in range(i + 1):
                                even[i, j] = even[i, j] + g[i] * g[j]
                        squares += off * off
                        count += wp.float64(1.0)
            if step == 0:  # the height alone, which all other derivatives have as a factor
                scale = even[0, 0] * even[1, 1] - even[1, 0] * even[1, 0]
                height = float((even[1, 1] * even_right[0] - even[1, 0] * even_right[1]) / scale)
                middle = float((even[0, 0] * even_right[1] - even[1, 0] * even_right[0]) / scale)
            else:
                move = solve4(odd, odd_right)
                change = solve5(even, even_right)
                p += wp.vec2(
                    wp.clamp(float(move[0]), -1.0, 1.0), wp.clamp(float(move[1]), -1.0, 1.0)
                )
                slope += wp.vec2(float(move[2]), float(move[3]))
                height += float(change[0])
                middle += float(change[1])
                edge_a = rotated(edge_a, wp.clamp(float(change[2]), -0.2, 0.2))
                edge_b = rotated(edge_b, wp.clamp(float(change[3]), -0.2, 0.2))
                s = wp.clamp(s + wp.clamp(float(change[4]), -0.5 * s, s), 0.25, 12.0)
                # The next step would be far less than this one.
                if wp.abs(move[0]) < STILL and wp.abs(move[1]) < STILL:
                    step = STEPS
            residual = wp.sqrt(squares / wp.max(count - wp.float64(9.0), wp.float64(1.0)))
            step += 1
        places[n, 0] = wp.float64(cy) + wp.float64(p[1])
        places[n, 1] = wp.float64(cx) + wp.float64(p[0])
        places[n, 2] = wp.float64(2.0) * wp.float64(height)
        places[n, 3] = residual
        places[n, 4] = wp.float64(s)


REFINE = {t: wp.overload(_refine, {"src": wp.array3d[t]}) for t in (wp.uint8, wp.float32)}
