"""A bilateral grid, in Taichi [Chen, Paris and Durand 2007].

A pixel and its value are a point in space and depth. A cell of the grid is as wide as a standard
deviation of the filter, and there are two more cells at each side. Values, and their number, are
added to the nearest cell, as integers, so their order has no effect. The cells are smoothed along
each axis by a Gaussian whose standard deviation is one cell. The filtered value of a pixel is the
quotient of both sums, each interpolated linearly at its point. One thread takes a pixel or a cell.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.raw import STEPS
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._rounding import product, quotient
from cvkern.kernels.taichi.raw._sums import add_up

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_4 = ti.types.ndarray(dtype=ti.f32, ndim=4)
i64_4 = ti.types.ndarray(dtype=ti.i64, ndim=4)
vec3 = ti.types.vector(3, ti.f32)


@ti.func
def _place(
    logs: f32_2, y: ti.i32, x: ti.i32, lowest: ti.f32, space: ti.f32, depth: ti.f32, zero: ti.i32
) -> vec3:
    """Return where a pixel and its value are in the grid."""
    return vec3(
        product(ti.cast(y, ti.f32), space, zero),
        product(ti.cast(x, ti.f32), space, zero),
        product(logs[y, x] - lowest, depth, zero),
    )


@ti.kernel
def _fill(logs: f32_2, lowest: ti.f32, space: ti.f32, depth: ti.f32, zero: ti.i32, cells: i64_4):
    for y, x in logs:
        at = ti.cast(_place(logs, y, x, lowest, space, depth, zero) + 2.5, ti.i32)
        value = product(logs[y, x] - lowest, float(STEPS), zero) + 0.5
        ti.atomic_add(cells[at[0], at[1], at[2], 0], ti.cast(ti.floor(value), ti.i64))
        ti.atomic_add(cells[at[0], at[1], at[2], 1], ti.i64(1))


@ti.kernel
def _smooth_depth(cells: i64_4, taps: f32_1, zero: ti.i32, out: f32_4):
    for y, x, z, part in out:
        total = 0.0
        for t in range(taps.shape[0]):
            u = z + t - taps.shape[0] // 2
            if 0 <= u < cells.shape[2]:
                total += product(taps[t], ti.cast(cells[y, x, u, part], ti.f32), zero)
        out[y, x, z, part] = total


@primitive
def fill(
    logs: np.ndarray,
    lowest: float,
    space: float,
    depth: float,
    taps: np.ndarray,
    cells: np.ndarray,
    out: np.ndarray,
) -> None:
    """Add values and their number to the nearest of (Y, X, Z, 2) cells; smooth along Z into `out`.

    Cells are 0 before. One thread a pixel, then one a number.
    """
    _fill(logs, lowest, space, depth, 0, cells)
    _smooth_depth(cells, taps, 0, out)


@ti.kernel
def _smooth(src: f32_4, taps: f32_1, axis: ti.i32, zero: ti.i32, out: f32_4):
    for y, x, z, part in out:
        total = 0.0
        for t in range(taps.shape[0]):
            v, u = y, x
            if axis == 0:
                v += t - taps.shape[0] // 2
            else:
                u += t - taps.shape[0] // 2
            if 0 <= v < src.shape[0] and 0 <= u < src.shape[1]:
                total += product(taps[t], src[v, u, z, part], zero)
        out[y, x, z, part] = total


@primitive
def smooth(src: np.ndarray, taps: np.ndarray, between: np.ndarray, out: np.ndarray) -> None:
    """Smooth along Y, into `between`, then along X; one thread a number."""
    _smooth(src, taps, 0, 0, between)
    _smooth(between, taps, 1, 0, out)


@ti.func
def _near(
    cells: ti.template(), y: ti.i32, x: ti.i32, z: ti.i32, fx: ti.f32, fz: ti.f32, part: ti.i32,
    zero: ti.i32,
) -> ti.f32:  # fmt: skip
    one, other = cells[y, x, z, part], cells[y, x + 1, z, part]
    a = one + product(fz, cells[y, x, z + 1, part] - one, zero)
    b = other + product(fz, cells[y, x + 1, z + 1, part] - other, zero)
    return a + product(fx, b - a, zero)


@ti.kernel
def _read(
    logs: f32_2,
    cells: f32_4,
    lowest: ti.f32,
    space: ti.f32,
    depth: ti.f32,
    zero: ti.i32,
    # outputs
    out: f32_2,
):
    for row, column in out:
        at = _place(logs, row, column, lowest, space, depth, zero) + 2.0
        y, x, z = ti.cast(at[0], ti.i32), ti.cast(at[1], ti.i32), ti.cast(at[2], ti.i32)
        f = at - ti.Vector([ti.cast(y, ti.f32), ti.cast(x, ti.f32), ti.cast(z, ti.f32)])
        sums = ti.Vector([0.0, 0.0])
        for part in ti.static(range(2)):
            a = _near(cells, y, x, z, f[1], f[2], part, zero)
            b = _near(cells, y + 1, x, z, f[1], f[2], part, zero)
            sums[part] = a + product(f[0], b - a, zero)
        out[row, column] = lowest + quotient(
            sums[0], product(ti.max(sums[1], 1e-12), float(STEPS), zero), zero
        )


@primitive
def read(
    logs: np.ndarray,
    cells: np.ndarray,
    lowest: float,
    space: float,
    depth: float,
    out: np.ndarray,
    sums: np.ndarray,
) -> None:
    """Write the mean of the cells around each pixel and its value, and measure these means.

    One thread a pixel.
    """
    _read(logs, cells, lowest, space, depth, 0, out)
    add_up(out, sums)
