"""Triangulation of projector columns or rows to points in space, in Taichi.

A column of the projector lights a plane. The ray d of a camera pixel meets it at the depth
``z = (x t_z - t_x) / ((R d)_x - x (R d)_z)``, where (R, t) is the pose of the projector and x the
undistorted column over its focal length. A lens bends the column into a curve, so x depends on the
row: a few iterations find the row from the point. One thread computes one pixel.
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.structured_light import LENS_STEPS
from cvkern.kernels.taichi._launch import primitive
from cvkern.kernels.taichi.geometry._lens import bent, straightened

f32_1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)


@primitive
def intersect(
    places: np.ndarray,
    valid: np.ndarray,
    lenses: np.ndarray,
    pose: np.ndarray,
    axis: int,
    points: np.ndarray,
) -> None:
    """Meet the rays of a camera with the planes of a projector's lines; one thread a pixel.

    `places` are columns (axis 0) or rows (axis 1), NaN or below -0.5 where unknown; `valid` is 0
    where they shall not count, or has one element. `lenses` are those of the camera and of the
    projector, `pose` is the rotation and the translation between them.
    """
    _intersect(places, valid, lenses, pose, axis, points)


@ti.kernel
def _intersect(
    places: f32_2,  # (H, W)
    valid: u8_2,  # (H, W), or (1, 1)
    lenses: f32_2,  # (2, 9)
    pose: f32_1,  # (12,)
    axis: ti.template(),
    # outputs
    points: f32_3,  # (H, W, 3)
):
    for i, j in places:
        place = places[i, j]
        known = place >= -0.5
        if valid.shape[0] == places.shape[0] and valid.shape[1] == places.shape[1]:
            known = known and valid[i, j] != 0
        ray = straightened(lenses, 0, ti.cast(i, ti.f32), ti.cast(j, ti.f32))
        x = ray[0]
        y = ray[1]
        across = pose[0] * x + pose[1] * y + pose[2]
        down = pose[3] * x + pose[4] * y + pose[5]
        ahead = pose[6] * x + pose[7] * y + pose[8]
        shift = pose[9]
        turned = across
        other = lenses[1, 3]  # coordinate along the projector's line: starts at its middle
        if ti.static(axis == 1):
            shift = pose[10]
            turned = down
            other = lenses[1, 2]
        z = 0.0
        for _ in range(LENS_STEPS):
            line = 0.0
            if ti.static(axis == 0):
                line = straightened(lenses, 1, other, place)[0]
            else:
                line = straightened(lenses, 1, place, other)[1]
            z = (line * pose[11] - shift) / (turned - line * ahead)
            depth = z * ahead + pose[11]
            seen = bent(lenses, 1, (z * across + pose[9]) / depth, (z * down + pose[10]) / depth)
            other = seen[axis]
            known = known and z > 0.0 and depth > 0.0
        if not known or ti.math.isnan(z) or ti.math.isinf(z):
            z = ti.math.nan
        points[i, j, 0] = z * x
        points[i, j, 1] = z * y
        points[i, j, 2] = z
