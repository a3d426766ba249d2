"""Triangulation of projector columns or rows to points in space, in Warp.

The Taichi set has the equation. One thread computes one pixel.
"""

import warp as wp

from cvkern.kernels.codes.structured_light import LENS_STEPS
from cvkern.kernels.warp._launch import launch_each
from cvkern.kernels.warp.geometry._lens import bent, straightened

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

STEPS = wp.constant(LENS_STEPS)


def intersect(
    places: wp.array,
    valid: wp.array,
    lenses: wp.array,
    pose: wp.array,
    axis: int,
    points: wp.array,
) -> None:
    """Meet the rays of a camera with the planes of a projector's lines; one thread a pixel.

    `places` are columns (axis 0) or rows (axis 1), NaN or below -0.5 where unknown; `valid` is 0
    where they shall not count, or has one element. `lenses` are those of the camera and of the
    projector, `pose` is the rotation and the translation between them.
    """
    count = places.shape[0] * places.shape[1]
    launch_each(_intersect, count, 40 * count, [places, valid, lenses, pose, axis], [points])


@wp.kernel
def _intersect(
    stride: int,
    first: int,
    last: int,
    places: wp.array2d[float],  # (H, W)
    valid: wp.array2d[wp.uint8],  # (H, W), or (1, 1)
    lenses: wp.array2d[float],  # (2, 9)
    pose: wp.array[float],  # (12,)
    axis: int,
    # outputs
    points: wp.array3d[float],  # (H, W, 3)
):
    width = places.shape[1]
    for item in range(first + wp.tid(), last, stride):
        i = item // width
        j = item - i * width
        place = places[i, j]
        known = place >= -0.5
        if valid.shape[0] == places.shape[0] and valid.shape[1] == width:
            known = known and valid[i, j] != wp.uint8(0)
        ray = straightened(lenses, 0, float(i), float(j))
        x = ray[0]
        y = ray[1]
        across = pose[0] * x + pose[1] * y + pose[2]
        down = pose[3] * x + pose[4] * y + pose[5]
        ahead = pose[6] * x + pose[7] * y + pose[8]
        shift = pose[9]
        turned = across
        other = lenses[1, 3]  # coordinate along the projector's line: starts at its middle
        if axis == 1:
            shift = pose[10]
            turned = down
            other = lenses[1, 2]
        z = float(0.0)
        for _ in range(STEPS):
            if axis == 0:
                line = straightened(lenses, 1, other, place)[0]
            else:
                line = straightened(lenses, 1, place, other)[1]
            z = (line * pose[11] - shift) / (turned - line * ahead)
            depth = z * ahead + pose[11]
            seen = bent(lenses, 1, (z * across + pose[9]) / depth, (z * down + pose[10]) / depth)
            other = seen[axis]
            known = known and z > 0.0 and depth > 0.0
        if not known or not wp.isfinite(z):
            z = wp.float32(wp.nan)
        points[i, j, 0] = z * x
        points[i, j, 1] = z * y
        points[i, j, 2] = z
