"""Corners in Warp: structure tensors, their measures, maxima, and places within the pixel.

The Taichi set has the equations. One thread takes a pixel or a point; on the CPU, a slab of them.
"""

import warp as wp

from cvkern.kernels.codes.features import Corner
from cvkern.kernels.warp._launch import launch_each

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


def multiply(dy: wp.array, dx: wp.array, yy: wp.array, yx: wp.array, xx: wp.array) -> None:
    """Products of the derivatives; one thread a pixel."""
    launch_each(_multiply, dy.shape[0], 2 * dy.size, [dy, dx], [yy, yx, xx])


def measure(
    yy: wp.array, yx: wp.array, xx: wp.array, rule: int, k: float, eps: float, dst: wp.array
) -> None:
    """Measure how much of a corner a structure tensor is; one thread a pixel."""
    launch_each(_measure, dst.shape[0], 2 * dst.size, [yy, yx, xx, rule, k, eps], [dst])


def mark_maxima(
    src: wp.array, distance: int, threshold: float, margin: int, mask: wp.array
) -> None:
    """Mark pixels above a threshold that no pixel of their window exceeds; one thread a pixel."""
    count = src.shape[0] * src.shape[1]
    launch_each(_mark, count, 4 * count, [src, distance, threshold, margin], [mask])


def locate(
    src: wp.array, points: wp.array, reach: int, dot: float, edge: float, places: wp.array
) -> None:
    """Find the point that the gradients of a window meet in or circle about; a thread a point."""
    count = points.shape[0]
    launch_each(_locate, count, 200 * count, [src, points, reach, dot, edge], [places])


@wp.kernel
def _multiply(
    stride: int,
    first: int,
    last: int,
    dy: wp.array[float],
    dx: wp.array[float],
    # outputs
    yy: wp.array[float],
    yx: wp.array[float],
    xx: wp.array[float],
):
    for i in range(first + wp.tid(), last, stride):
        yy[i] = dy[i] * dy[i]
        yx[i] = dy[i] * dx[i]
        xx[i] = dx[i] * dx[i]


@wp.kernel
def _measure(
    stride: int,
    first: int,
    last: int,
    yy: wp.array[float],
    yx: wp.array[float],
    xx: wp.array[float],
    rule: int,
    k: float,
    eps: float,
    # outputs
    dst: wp.array[float],
):
    for i in range(first + wp.tid(), last, stride):
        trace = yy[i] + xx[i]
        if rule == int(Corner.SHI_TOMASI):  # the smaller eigenvalue
            gap = yy[i] - xx[i]
            dst[i] = 0.5 * (trace - wp.sqrt(gap * gap + 4.0 * (yx[i] * yx[i])))
        else:
            det = yy[i] * xx[i] - yx[i] * yx[i]
            if rule == int(Corner.HARRIS):
                dst[i] = det - k * (trace * trace)
            else:
                dst[i] = 2.0 * det / (trace + eps)


@wp.kernel
def _mark(
    stride: int,
    first: int,
    last: int,
    src: wp.array2d[float],
    distance: int,
    threshold: float,
    margin: int,
    # outputs
    mask: wp.array2d[wp.uint8],
):
    height = src.shape[0]
    width = src.shape[1]
    for item in range(first + wp.tid(), last, stride):
        y = item // width
        x = item - y * width
        v = src[y, x]
        found = v > threshold
        if y < margin or y >= height - margin or x < margin or x >= width - margin:
            found = False
        i = wp.max(y - distance, 0)
        bottom = wp.min(y + distance, height - 1)
        while found and i <= bottom:
            for j in range(wp.max(x - distance, 0), wp.min(x + distance, width - 1) + 1):
                if src[i, j] > v:
                    found = False
            i += 1
        mask[y, x] = wp.uint8(wp.where(found, 1, 0))


@wp.func
def pixel(src: wp.array2d[float], y: int, x: int) -> wp.float64:
    """Return a pixel, 0 outside the image."""
    if y < 0 or x < 0 or y >= src.shape[0] or x >= src.shape[1]:
        return wp.float64(0.0)
    return wp.float64(src[y, x])


@wp.kernel
def _locate(
    stride: int,
    first: int,
    last: int,
    src: wp.array2d[float],
    points: wp.array2d[int],
    reach: int,
    dot: float,
    edge: float,
    # outputs
    places: wp.array2d[float],
):
    zero = wp.float64(0.0)
    two = wp.float64(2.0)
    for n in range(first + wp.tid(), last, stride):
        cy = points[n, 0]
        cx = points[n, 1]
        xx = zero
        xy = zero
        yy = zero
        xx_y = zero
        xx_x = zero
        xy_y = zero
        xy_x = zero
        yy_y = zero
        yy_x = zero
        spin = zero  # moments of the second order: across the gradient, and along it
        meet = zero
        for i in range(-reach, reach + 1):
            for j in range(-reach, reach + 1):
                y = cy + i
                x = cx + j
                nw = pixel(src, y - 1, x - 1)
                ne = pixel(src, y - 1, x + 1)
                sw = pixel(src, y + 1, x - 1)
                se = pixel(src, y + 1, x + 1)
                gy = (sw - nw) + two * (pixel(src, y + 1, x) - pixel(src, y - 1, x)) + (se - ne)
                gx = (ne - nw) + two * (pixel(src, y, x + 1) - pixel(src, y, x - 1)) + (se - sw)
                v = wp.float64(i)
                u = wp.float64(j)
                a = gx * gx
                b = gx * gy
                c = gy * gy
                xx += a
                xy += b
                yy += c
                xx_y += a * v
                xx_x += a * u
                xy_y += b * v
                xy_x += b * u
                yy_y += c * v
                yy_x += c * u
                spin += a * (v * v) - two * (b * (u * v)) + c * (u * u)
                meet += c * (v * v) + two * (b * (u * v)) + a * (u * u)
        nowhere = wp.float32(wp.nan)
        row = nowhere
        column = nowhere
        det = xx * yy - xy * xy
        if det != zero:
            # A dot: lines along the gradients meet in it. An edge corner: lines across do.
            r = xx_y - xy_x
            s = yy_x - xy_y
            dot_y = (yy * r + xy * s) / det
            dot_x = (xy * r + xx * s) / det
            t = yy_y + xy_x
            w = xx_x + xy_y
            edge_y = (xx * t - xy * w) / det
            edge_x = (yy * w - xy * t) / det
            # At the least squares solution the sum is the constant less what the solution gains.
            of_dot = spin - (dot_y * r + dot_x * s)
            of_edge = meet - (edge_y * t + edge_x * w)
            ratio = wp.float64(wp.inf)
            if of_dot != zero:
                ratio = of_edge / of_dot
            least = wp.float64(2.220446049250313e-16)
            if not (of_dot < least and of_edge < least):
                if ratio < wp.float64(edge):
                    row = float(wp.float64(cy) + edge_y)
                    column = float(wp.float64(cx) + edge_x)
                elif ratio > wp.float64(dot):
                    row = float(wp.float64(cy) + dot_y)
                    column = float(wp.float64(cx) + dot_x)
        places[n, 0] = row
        places[n, 1] = column
