"""Sub-pixel edge points, in Taichi: one thread per row.

Across a blurred straight step the gradient is a Gaussian, along both axes. Its logarithm is a
parabola, and the edge is at the maximum of this parabola. With a, b and c the logarithms before, at
and after a pixel, the maximum is at the offset ``(a - c) / (2 (a - 2 b + c))``.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.edges import Norm
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._polar import gradient_angle
from cvkern.kernels.taichi._rounding import quotient, root

from .masks import _measure

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)


@ti.func
def _peak(dy: ti.template(), dx: ti.template(), y: ti.i32, x: ti.i32, zero: ti.i32) -> ti.math.vec3:
    """Return squared magnitudes before, at and after a pixel, along its larger derivative.

    Return three zeros if the pixel is not a maximum with two neighbours.
    """
    sy = 0
    sx = 1
    if ti.abs(dy[y, x]) > ti.abs(dx[y, x]):
        sy = 1
        sx = 0
    before = _measure(dy, dx, y - sy, x - sx, Norm.L2, zero)
    here = _measure(dy, dx, y, x, Norm.L2, zero)
    after = _measure(dy, dx, y + sy, x + sx, Norm.L2, zero)
    peak = ti.Vector([0.0, 0.0, 0.0])
    if before > 0.0 and after > 0.0 and here > before and here >= after:
        peak = ti.Vector([before, here, after])
    return peak


@ti.kernel
def _count_edges(
    dy: f32_2,
    dx: f32_2,
    mask: u8_2,
    zero: ti.i32,
    # outputs
    counts: i32_1,
):
    for y in range(dy.shape[0]):
        count = 0
        for x in range(dy.shape[1]):
            if mask[y, x] != 0 and _peak(dy, dx, y, x, zero)[1] > 0.0:
                count += 1
        counts[y] = count


@primitive
def count_edges(dy: np.ndarray, dx: np.ndarray, mask: np.ndarray, counts: np.ndarray) -> None:
    """Count the sub-pixel edges of each row; one thread per row."""
    _count_edges(dy, dx, mask, 0, counts)


@ti.kernel
def _gather_edges(
    dy: f32_2,
    dx: f32_2,
    mask: u8_2,
    starts: i32_1,
    zero: ti.i32,
    # outputs
    points: f32_2,
    orientation: f32_1,
    strength: f32_1,
):
    for y in range(dy.shape[0]):
        n = starts[y]
        for x in range(dy.shape[1]):
            if mask[y, x] != 0:
                peak = _peak(dy, dx, y, x, zero)
                if peak[1] > 0.0:
                    # The maximum of the Gaussian through the three: a parabola in logarithms.
                    a = ti.log(peak[0])
                    b = ti.log(peak[1])
                    c = ti.log(peak[2])
                    offset = quotient(0.5 * (a - c), (a - 2.0 * b) + c, zero)
                    along_rows = ti.abs(dy[y, x]) > ti.abs(dx[y, x])
                    points[n, 0] = y + (offset if along_rows else 0.0)
                    points[n, 1] = x + (0.0 if along_rows else offset)
                    orientation[n] = gradient_angle(dy[y, x], dx[y, x], zero)
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
    _gather_edges(dy, dx, mask, starts, 0, points, orientation, strength)
