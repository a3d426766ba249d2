"""Sampling of images at given coordinates, and its gradients, in Taichi.

The value at (y, x) is ``sum_ij B(y - i) B(x - j) c_ij`` with the B-spline B (_taps.py), and c the
pixels, or for order 3 the coefficients of the spline (_spline.py). Its derivatives by y and x have
B' in place of B; those by the pixels are sums over all samples, in float64, which the transposed
recursion takes from the coefficients to the pixels. One thread
takes a pixel, or a line.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.transform import OUTSIDE
from cvkern.kernels.taichi._launch import primitive, scratch

from . import _spline as spline
from ._taps import first_tap, mapped, sample, slopes, stored, tap_index, weights

f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
f32_4 = ti.types.ndarray(dtype=ti.f32, ndim=4)
f64_4 = ti.types.ndarray(dtype=ti.f64, ndim=4)
any_4 = ti.types.ndarray(ndim=4)  # u8 or f32


@primitive
def prefilter(src: np.ndarray, margin: int, reflect: int, coefficients: np.ndarray) -> None:
    """Coefficients of the cubic spline through an image, with a margin; one thread a line."""
    spline.pad(src, margin, coefficients)
    _recurse_both(coefficients, reflect)


@primitive
def prefilter_backward(sums: np.ndarray, margin: int, reflect: int, grad_src: np.ndarray) -> None:
    """Gradients by the pixels from those by the coefficients of the spline; one thread a line."""
    buffer = scratch(sums.shape, np.float32)
    spline.narrow(sums, 1 - reflect, buffer)
    _recurse_both(buffer, reflect)
    spline.fold(buffer, margin, 1 - reflect, grad_src)


@primitive
def narrow(sums: np.ndarray, grad_src: np.ndarray) -> None:
    """Gradients by the pixels from their sums in float64; one thread a pixel."""
    spline.narrow(sums, 0, grad_src)


def _recurse_both(coefficients: np.ndarray, reflect: int) -> None:
    planes, height, width, channels = coefficients.shape
    if height > 1:
        spline.recurse(reflect, 0, coefficients.reshape((planes, height, width * channels)))
    if width > 1:
        spline.recurse(reflect, 0, coefficients.reshape((planes * height, width, channels)))


@primitive
def remap(
    src: np.ndarray,
    coordinates: np.ndarray,
    order: int,
    border: int,
    cval: float,
    margin: int,
    dst: np.ndarray,
) -> None:
    """Sample an image, or the coefficients of its spline, at coordinates; one thread a pixel."""
    _remap(src, coordinates, order, dst.dtype == np.uint8, border, cval, margin, 0, dst)


@ti.kernel
def _remap(
    src: any_4,  # (P, H, W, C)
    coordinates: f32_3,  # (2, H', W')
    order: ti.template(),
    rounded: ti.template(),
    border: ti.i32,
    cval: ti.f32,
    margin: ti.i32,
    zero: ti.i32,
    # outputs
    dst: any_4,  # (P, H', W', C)
):
    for i, j in ti.ndrange(dst.shape[1], dst.shape[2]):
        shift = ti.cast(margin, ti.f64)
        at_y = ti.cast(coordinates[0, i, j], ti.f64) + shift
        at_x = ti.cast(coordinates[1, i, j], ti.f64) + shift
        y, _ = mapped(at_y, src.shape[1], border, zero)
        x, _ = mapped(at_x, src.shape[2], border, zero)
        for p in range(dst.shape[0]):
            for c in range(dst.shape[3]):
                v = cval
                if y != OUTSIDE and x != OUTSIDE:
                    v = sample(src, p, c, y, x, order, border, zero)
                if ti.static(rounded):
                    dst[p, i, j, c] = ti.cast(stored(v), ti.u8)
                else:
                    dst[p, i, j, c] = v


@primitive
def remap_backward(
    grad: np.ndarray,
    src: np.ndarray,
    coordinates: np.ndarray,
    order: int,
    border: int,
    margin: int,
    grad_src: np.ndarray,
    grad_coordinates: np.ndarray,
) -> None:
    """Gradients by the sampled image, added in float64, and by coordinates; one thread a pixel."""
    _clear(grad_src)
    _backward(grad, src, coordinates, order, border, margin, 0, grad_src, grad_coordinates)


@ti.kernel
def _clear(sums: f64_4):
    for p, y, x, c in sums:
        sums[p, y, x, c] = 0.0


@ti.kernel
def _backward(
    grad: f32_4,  # (P, H', W', C)
    src: f32_4,  # (P, H, W, C)
    coordinates: f32_3,  # (2, H', W')
    order: ti.template(),
    border: ti.i32,
    margin: ti.i32,
    zero: ti.i32,
    # outputs
    grad_src: f64_4,  # (P, H, W, C)
    grad_coordinates: f32_3,  # (2, H', W')
):
    # With v = sum_ij down_i along_j src_ij and g the gradient by v: dsrc_ij += g down_i along_j,
    # dy = g y' sum_ij down'_i along_j src_ij, and dx alike, where y' is 1 or -1 (mirrored).
    for i, j in ti.ndrange(grad.shape[1], grad.shape[2]):
        shift = ti.cast(margin, ti.f64)
        at_y = ti.cast(coordinates[0, i, j], ti.f64) + shift
        at_x = ti.cast(coordinates[1, i, j], ti.f64) + shift
        y, y_slope = mapped(at_y, src.shape[1], border, zero)
        x, x_slope = mapped(at_x, src.shape[2], border, zero)
        by_y = ti.cast(0.0, ti.f64)
        by_x = ti.cast(0.0, ti.f64)
        if y != OUTSIDE and x != OUTSIDE:
            down = ti.cast(weights(y, order, zero), ti.f64)
            along = ti.cast(weights(x, order, zero), ti.f64)
            steeper = ti.cast(slopes(y, order, zero), ti.f64)
            wider = ti.cast(slopes(x, order, zero), ti.f64)
            top = first_tap(y, order)
            left = first_tap(x, order)
            for p in range(grad.shape[0]):
                for c in range(grad.shape[3]):
                    g = ti.cast(grad[p, i, j, c], ti.f64)
                    for a in ti.static(range(order + 1)):
                        row = tap_index(top + a, src.shape[1], border)
                        for b in ti.static(range(order + 1)):
                            column = tap_index(left + b, src.shape[2], border)
                            v = g * ti.cast(src[p, row, column, c], ti.f64)
                            by_y += v * steeper[a] * along[b]
                            by_x += v * down[a] * wider[b]
                            ti.atomic_add(grad_src[p, row, column, c], g * down[a] * along[b])
        grad_coordinates[0, i, j] = ti.cast(by_y * y_slope, ti.f32)
        grad_coordinates[1, i, j] = ti.cast(by_x * x_slope, ti.f32)
