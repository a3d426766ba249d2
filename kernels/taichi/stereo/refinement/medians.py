"""The weighted median of disparities, guided by an image, in Taichi.

The median runs along the rows, and then down the columns of the result. A pixel of the window has
the weight max(1, contrast - g), where g is the difference of the guide's values there and in the
middle. The median is the smallest value that, with all smaller and equal values, has at least half
of the weight. One thread per pixel.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.taichi._launch import primitive, scratch

from ._bits import is_number, none

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)


@ti.func
def _inside(i: ti.i32, size: ti.i32) -> ti.i32:
    return ti.min(ti.max(i, 0), size - 1)


@ti.kernel
def _median(
    disparity: f32_2,
    guide: u8_2,
    radius: ti.i32,
    contrast: ti.i32,
    dy: ti.i32,  # the line of the window: (1, 0) or (0, 1)
    dx: ti.i32,
    # outputs
    smooth: f32_2,
):
    height = disparity.shape[0]
    width = disparity.shape[1]
    for y, x in smooth:
        # The smallest value of the window that, with all smaller and equal ones, has at least
        # half of the weight.
        exists = 0
        best = 0.0
        for i in range(-radius, radius + 1):
            value = disparity[_inside(y + i * dy, height), _inside(x + i * dx, width)]
            if is_number(value):
                total = 0
                below = 0
                for j in range(-radius, radius + 1):
                    v = _inside(y + j * dy, height)
                    u = _inside(x + j * dx, width)
                    other = disparity[v, u]
                    step = ti.cast(guide[v, u], ti.i32) - ti.cast(guide[y, x], ti.i32)
                    weight = ti.max(1, contrast - ti.abs(step))
                    if is_number(other):
                        total += weight
                        if other <= value:
                            below += weight
                if 2 * below >= total and (exists == 0 or value < best):
                    best = value
                    if value == 0.0:  # no -0; Taichi would leave out the sum with 0
                        best = 0.0
                    exists = 1
        smooth[y, x] = best if exists == 1 else none()


@primitive
def guided_median(
    disparity: np.ndarray, guide: np.ndarray, radius: int, contrast: int, smooth: np.ndarray
) -> None:
    """Apply the weighted median along the rows, then down the columns; one thread per pixel.

    A pixel that differs by g from the middle one in the guide has the weight
    ``max(1, contrast - g)``. Outside the image, the nearest pixel is repeated.
    """
    across = scratch(smooth.shape, np.float32)
    _median(disparity, guide, radius, contrast, 0, 1, across)
    _median(across, guide, radius, contrast, 1, 0, smooth)


def max_radius() -> int:
    """Return the largest radius that the kernels support."""
    return 15
