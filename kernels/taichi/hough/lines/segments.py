"""The line that a point belongs to, in Taichi: one thread per point.

A point (y, x) is on a line if ``|x cos + y sin - rho|`` is at most a distance and its direction is
within a tolerance of the line's.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.hough import DIRECTIONS
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi._rounding import product

HALF_TURN = DIRECTIONS // 2

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)


@ti.kernel
def _claim(
    points: f32_2,
    codes: i32_1,
    after: i32_1,
    lines: f32_2,
    directions: i32_1,
    distance: ti.f32,
    tolerance: ti.i32,
    zero: ti.i32,
    # outputs
    labels: i32_1,
):
    for i in labels:
        label = lines.shape[1]
        for k in range(after[i] + 1, lines.shape[1]):
            turn = (codes[i] - directions[k]) & (HALF_TURN - 1)
            angle = ti.min(turn, HALF_TURN - turn)
            along = product(points[i, 1], lines[0, k], zero)
            along += product(points[i, 0], lines[1, k], zero)
            if ti.abs(along - lines[2, k]) <= distance and angle <= tolerance:
                label = ti.min(label, k)
        labels[i] = label


@primitive
def claim(
    points: np.ndarray,
    codes: np.ndarray,
    after: np.ndarray,
    lines: np.ndarray,
    directions: np.ndarray,
    distance: float,
    tolerance: int,
    labels: np.ndarray,
) -> None:
    """Label every point with the first line after `after` that it is on, or the number of lines.

    `lines` has rows of cosines, sines and distances, (3, K).
    """
    _claim(points, codes, after, lines, directions, distance, tolerance, 0, labels)
