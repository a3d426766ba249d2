"""Which line a point belongs to, in Taichi."""

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
    cosine: f32_1,
    sine: f32_1,
    rho: f32_1,
    directions: i32_1,
    distance: ti.f32,
    tolerance: ti.i32,
    zero: ti.i32,
    # outputs
    labels: i32_1,
):
    for i in labels:
        label = cosine.shape[0]
        for k in range(after[i] + 1, cosine.shape[0]):
            turn = (codes[i] - directions[k]) & (HALF_TURN - 1)
            angle = ti.min(turn, HALF_TURN - turn)
            along = product(points[i, 1], cosine[k], zero) + product(points[i, 0], sine[k], zero)
            if ti.abs(along - rho[k]) <= distance and angle <= tolerance:
                label = ti.min(label, k)
        labels[i] = label


@primitive
def claim(
    points: np.ndarray,
    codes: np.ndarray,
    after: np.ndarray,
    cosine: np.ndarray,
    sine: np.ndarray,
    rho: np.ndarray,
    directions: np.ndarray,
    distance: float,
    tolerance: int,
    labels: np.ndarray,
) -> None:
    """Label every point with the first line, behind `after`, that it is on, or their number.

    One thread a point.
    """
    _claim(points, codes, after, cosine, sine, rho, directions, distance, tolerance, 0, labels)
