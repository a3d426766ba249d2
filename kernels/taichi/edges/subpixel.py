"""Sub-pixel edge points, in Taichi: one thread per row.

Across a blurred straight step the gradient is a Gaussian, along both axes. Its logarithm is a
parabola, and the edge is at the maximum of this parabola. With p and q the logarithms before and
after a pixel less the one at it, the maximum is at the offset ``(p - q) / (2 (p + q))``.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.edges import LEAST_MANTISSA, LEAST_RATIO, LN2, LOG, MANTISSA_BITS, Norm
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._polar import gradient_angle
from cvkern.kernels.taichi._rounding import product, quotient, root

from .masks import _measure

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)


@ti.func
def _log_of_ratio(a: ti.f32, b: ti.f32, zero: ti.i32) -> ti.f32:
    """Logarithm of a / b: sums, products and quotients alone, so equal bits on every device."""
    ratio = ti.max(quotient(a, b, zero), LEAST_RATIO)
    bits = ti.bit_cast(ratio, ti.i32)
    exponent = (bits - LEAST_MANTISSA) >> MANTISSA_BITS
    m = ti.bit_cast(bits - (exponent << MANTISSA_BITS), ti.f32)
    s = quotient(m - 1.0, m + 1.0, zero)
    z = product(s, s, zero)
    series = ti.cast(LOG[4], ti.f32)
    for k in ti.static((3, 2, 1, 0)):
        series = product(series, z, zero) + LOG[k]
    whole = product(ti.cast(exponent, ti.f32), ti.cast(LN2, ti.f32), zero)
    return product(2.0 * s, series, zero) + whole


@ti.func
def _peak(dy: ti.template(), dx: ti.template(), y: ti.i32, x: ti.i32, zero: ti.i32) -> ti.math.vec3:
    """Return squared magnitudes before, at and after a pixel, along its larger derivative.

    Return three zeros if the pixel is not a maximum with two neighbours.
    """
    sy = 0
    sx = 1
    if ti.abs(dy[0, y, x]) > ti.abs(dx[0, y, x]):
        sy = 1
        sx = 0
    before = _measure(dy, dx, 0, y - sy, x - sx, Norm.L2, zero)
    here = _measure(dy, dx, 0, y, x, Norm.L2, zero)
    after = _measure(dy, dx, 0, y + sy, x + sx, Norm.L2, zero)
    peak = ti.Vector([0.0, 0.0, 0.0])
    bounded = here < ti.math.inf  # the logarithm of infinity tells nothing
    if before > 0.0 and after > 0.0 and here > before and here >= after and bounded:
        peak = ti.Vector([before, here, after])
    return peak


@ti.kernel
def _count_edges(
    dy: f32_3,  # (1, H, W)
    dx: f32_3,
    mask: u8_2,
    zero: ti.i32,
    # outputs
    counts: i32_1,
):
    for y in range(dy.shape[1]):
        count = 0
        for x in range(dy.shape[2]):
            if mask[y, x] != 0 and _peak(dy, dx, y, x, zero)[1] > 0.0:
                count += 1
        counts[y] = count


@primitive
def count_edges(dy: np.ndarray, dx: np.ndarray, mask: np.ndarray, counts: np.ndarray) -> None:
    """Count the sub-pixel edges of each row; one thread per row."""
    planes = 1, *dy.shape
    _count_edges(dy.reshape(planes), dx.reshape(planes), mask, 0, counts)


@ti.kernel
def _gather_edges(
    dy: f32_3,  # (1, H, W)
    dx: f32_3,
    mask: u8_2,
    starts: i32_1,
    zero: ti.i32,
    # outputs
    points: f32_2,
    orientation: f32_1,
    strength: f32_1,
):
    for y in range(dy.shape[1]):
        n = starts[y]
        for x in range(dy.shape[2]):
            if mask[y, x] != 0:
                peak = _peak(dy, dx, y, x, zero)
                if peak[1] > 0.0:
                    p = _log_of_ratio(peak[0], peak[1], zero)
                    q = _log_of_ratio(peak[2], peak[1], zero)
                    offset = quotient(0.5 * (p - q), p + q, zero)
                    along_rows = ti.abs(dy[0, y, x]) > ti.abs(dx[0, y, x])
                    points[n, 0] = y + (offset if along_rows else 0.0)
                    points[n, 1] = x + (0.0 if along_rows else offset)
                    orientation[n] = gradient_angle(dy[0, y, x], dx[0, y, x], zero)
                    strength[n] = root(peak[1], zero)
                    n += 1


@primitive
def gather_edges(
    dy: np.ndarray,
    dx: np.ndarray,
    mask: np.ndarray,
    starts: np.ndarray,
    points: np.ndarray,
    orientation: np.ndarray,
    strength: np.ndarray,
) -> None:
    """Write the sub-pixel edges of each row in raster order; one thread per row."""
    planes = 1, *dy.shape
    slopes = dy.reshape(planes), dx.reshape(planes)
    _gather_edges(*slopes, mask, starts, 0, points, orientation, strength)
