"""Sampling of images at given coordinates, and its gradients, in Warp.

The value at (y, x) is ``sum_ij B(y - i) B(x - j) c_ij`` with the B-spline B (_taps.py), and c the
pixels, or for order 3 the coefficients of the spline (_spline.py). Its derivatives by y and x have
B' in place of B; those by the pixels are sums over all samples, in float64, which the transposed
recursion takes from the coefficients to the pixels. One thread
takes a pixel, or a line; on the CPU, a slab of them.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.filters import Border
from cvkern.kernels.warp._launch import launch_each, launch_slabs, scratch, slabs, view
from cvkern.kernels.warp._zeros import clear

from . import _spline as spline
from ._projective_cpu import FEW, PART, TALL, native_tile
from ._taps import AWAY, mapped, taps, writer

OPTIONS = {"enable_backward": False, "fuse_fp": False}


def prefilter(src: wp.array, margin: int, reflect: int, coefficients: wp.array) -> None:
    """Coefficients of the cubic spline through an image, with a margin; one thread a line."""
    planes, height, width, channels = coefficients.shape
    rows = planes * height
    launch_each(spline.pad, rows * width, coefficients.size, [src, margin], [coefficients])
    down = view(coefficients, wp.float32, (planes, height, width * channels))
    along = view(coefficients, wp.float32, (rows, width, channels))
    for lines in (down, along):
        _recurse(lines, reflect)


def prefilter_backward(sums: wp.array, margin: int, reflect: int, grad_src: wp.array) -> None:
    """Gradients by the pixels from those by the coefficients of the spline; one thread a line."""
    planes, height, width, channels = sums.shape
    rows = planes * height
    mirrored = 1 - reflect
    buffer = scratch("prefilter.gradient", sums.shape, wp.float32, sums.device)
    launch_each(spline.narrow, rows * width, sums.size, [sums, mirrored], [buffer])
    down = view(buffer, wp.float32, (planes, height, width * channels))
    along = view(buffer, wp.float32, (rows, width, channels))
    for lines in (along, down):
        _recurse(lines, reflect)
    count = grad_src.shape[0] * grad_src.shape[1] * grad_src.shape[2]
    launch_each(spline.fold, count, grad_src.size, [buffer, margin, mirrored], [grad_src])


def narrow(sums: wp.array, grad_src: wp.array) -> None:
    """Gradients by the pixels from their sums in float64; one thread a pixel."""
    planes, height, width, _ = sums.shape
    launch_each(spline.narrow, planes * height * width, sums.size, [sums, 0], [grad_src])


def _recurse(lines: wp.array, reflect: int) -> None:
    outer, n, inner = lines.shape
    if n > 1:  # a line of one pixel is its own spline
        launch_each(spline.recurse, outer * inner, lines.size, [reflect], [lines])


def remap(
    src: wp.array,
    coordinates: wp.array,
    order: int,
    border: int,
    cval: float,
    margin: int,
    dst: wp.array,
) -> None:
    """Sample an image, or the coefficients of its spline, at coordinates; one thread a pixel.

    For orders 0 and 1 and few channels the CPU takes vectors of pixels.
    """
    rows = dst.shape[1]
    if order < 2 and src.shape[3] in FEW and not dst.device.is_cuda:
        parts = slabs(rows, dst.size)
        left = scratch("projective.left", (parts, TALL * PART), wp.int32, dst.device)
        few = remap_kernel_cpu(src.dtype, dst.dtype, src.shape[3], order)
        launch_slabs(few, rows, parts, [src, coordinates, border, cval, left], [dst])
        return
    kernel = remap_kernel(src.dtype, dst.dtype, order)
    count = dst.shape[1] * dst.shape[2]
    launch_each(kernel, count, dst.size, [src, coordinates, border, cval, margin], [dst])


def remap_backward(
    grad: wp.array,
    src: wp.array,
    coordinates: wp.array,
    order: int,
    border: int,
    margin: int,
    grad_src: wp.array,
    grad_coordinates: wp.array,
) -> None:
    """Gradients by the sampled image, added in float64, and by coordinates; one thread a pixel."""
    count = grad.shape[1] * grad.shape[2]
    clear(grad_src)
    inputs = [grad, src, coordinates, border, margin]
    # One slab on the CPU: sums of several threads would need atomics, and have no one order.
    launch_each(backward_kernel(order), count, 0, inputs, [grad_src, grad_coordinates])


@lru_cache
def remap_kernel(scalar: Any, result: Any, order: int) -> wp.Kernel:
    """Make the kernel that samples arrays of `scalar`."""
    write = writer(scalar, result, order)

    @wp.kernel(module="unique", module_options=OPTIONS)
    def remap_pixels(
        stride: int,
        first: int,
        last: int,
        src: wp.array4d[scalar],  # (P, H, W, C)
        coordinates: wp.array3d[float],  # (2, H', W')
        border: int,
        cval: float,
        margin: int,
        # outputs
        dst: wp.array4d[result],  # (P, H', W', C)
    ):
        width = dst.shape[2]
        for item in range(first + wp.tid(), last, stride):
            i = item // width
            j = item - i * width
            shift = wp.float64(margin)
            y = mapped(wp.float64(coordinates[0, i, j]) + shift, src.shape[1], border)[0]
            x = mapped(wp.float64(coordinates[1, i, j]) + shift, src.shape[2], border)[0]
            write(src, y, x, border, cval, i, j, dst)

    return remap_pixels


@lru_cache
def remap_kernel_cpu(scalar: Any, result: Any, channels: int, order: int) -> wp.Kernel:
    """Make the kernel of the CPU for orders 0 and 1 and few channels: 16 pixels of a row at a time.

    Plain Warp finds each pixel alone, and forms no vectors.
    """
    write = writer(scalar, result, order)
    tile = native_tile(scalar, result, channels, order, True)

    @wp.kernel(module="unique", module_options=OPTIONS)
    def remap_rows(
        slab: int,
        first: int,
        last: int,
        src: wp.array4d[scalar],  # (P, H, W, C)
        coordinates: wp.array3d[float],  # (2, H', W')
        border: int,
        cval: float,
        # scratch
        left: wp.array2d[int],  # (slabs, TALL * PART)
        # outputs
        dst: wp.array4d[result],  # (P, H', W', C)
    ):
        constant = int(0)
        if border == int(Border.CONSTANT):
            constant = int(1)
        across = (dst.shape[2] + PART - 1) // PART
        for item in range((last - first + TALL - 1) // TALL * across):
            top = first + item // across * TALL
            start = item % across * PART
            bottom = wp.min(top + TALL, last)
            count = tile(top, bottom, start, slab, src, coordinates, constant, cval, left, dst)
            for k in range(count):
                place = left[slab, k]
                i = top + place // PART
                j = start + place % PART
                y = mapped(wp.float64(coordinates[0, i, j]), src.shape[1], border)[0]
                x = mapped(wp.float64(coordinates[1, i, j]), src.shape[2], border)[0]
                write(src, y, x, border, cval, i, j, dst)

    return remap_rows


@lru_cache
def backward_kernel(order: int) -> wp.Kernel:
    """Make the kernel of the gradients of `remap`.

    With v = sum_ij down_i along_j src_ij and g the gradient by v: dsrc_ij += g down_i along_j,
    dy = g y' sum_ij down'_i along_j src_ij, and dx alike, where y' is 1 or -1 (mirrored).
    """
    _, _, indices, weights, slopes = taps(order)
    count = order + 1

    @wp.kernel(module="unique", module_options=OPTIONS)
    def backward(
        stride: int,
        first: int,
        last: int,
        grad: wp.array4d[float],  # (P, H', W', C)
        src: wp.array4d[float],  # (P, H, W, C)
        coordinates: wp.array3d[float],  # (2, H', W')
        border: int,
        margin: int,
        # outputs
        grad_src: wp.array4d[wp.float64],  # (P, H, W, C)
        grad_coordinates: wp.array3d[float],  # (2, H', W')
    ):
        width = grad.shape[2]
        for item in range(first + wp.tid(), last, stride):
            i = item // width
            j = item - i * width
            shift = wp.float64(margin)
            y = mapped(wp.float64(coordinates[0, i, j]) + shift, src.shape[1], border)
            x = mapped(wp.float64(coordinates[1, i, j]) + shift, src.shape[2], border)
            by_y = wp.float64(0.0)
            by_x = wp.float64(0.0)
            if y[0] != wp.float64(AWAY) and x[0] != wp.float64(AWAY):
                rows = indices(y[0], src.shape[1], border)
                columns = indices(x[0], src.shape[2], border)
                down = weights(y[0])
                along = weights(x[0])
                steeper = slopes(y[0])
                wider = slopes(x[0])
                for p in range(grad.shape[0]):
                    for c in range(grad.shape[3]):
                        g = wp.float64(grad[p, i, j, c])
                        for a in range(wp.static(count)):
                            for b in range(wp.static(count)):
                                v = g * wp.float64(src[p, rows[a], columns[b], c])
                                by_y += v * wp.float64(steeper[a]) * wp.float64(along[b])
                                by_x += v * wp.float64(down[a]) * wp.float64(wider[b])
                                wp.atomic_add(
                                    grad_src, p, rows[a], columns[b], c,
                                    g * wp.float64(down[a]) * wp.float64(along[b]),
                                )  # fmt: skip
            grad_coordinates[0, i, j] = float(by_y * y[1])
            grad_coordinates[1, i, j] = float(by_x * x[1])

    return backward
