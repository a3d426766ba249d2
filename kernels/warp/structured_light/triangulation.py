"""Triangulation of projector columns or rows to points in space, in Warp.

The Taichi set has the equation, and equal bits on the CPU. There a thread computes a slab of rows,
on CUDA a run of pixels.
"""

from functools import lru_cache

import warp as wp

from cvkern.kernels.codes.structured_light import LENS_STEPS, NEAR, STILL
from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import launch, launch_slabs, slabs
from cvkern.kernels.warp.geometry._lens import NEWTON_STEPS, WIDEST

OPTIONS = {"enable_backward": False}
EXACT = OPTIONS | {"fuse_fp": False}
_RUN = 8  # pixels of a thread on CUDA
_NUMBERS = {"NEWTON_STEPS": NEWTON_STEPS, "WIDEST": f"{WIDEST:.1f}f", "LENS_STEPS": LENS_STEPS,
            "NEAR": f"{NEAR}f", "STILL": f"{STILL}f"}  # fmt: skip


def intersect(
    places: wp.array,
    valid: wp.array,
    lenses: wp.array,
    pose: wp.array,
    axis: int,
    points: wp.array,
) -> None:
    """Meet the rays of a camera with the planes of a projector's lines.

    `places` are columns (axis 0) or rows (axis 1), NaN or below -0.5 where unknown; `valid` is 0
    where they shall not count, or has one element. `lenses` are those of the camera and of the
    projector, `pose` is the rotation and the translation between them.
    """
    inputs = [places, valid, lenses, pose]
    rows, pixels = places.shape[0], places.size
    if points.device.is_cuda:
        launch(_intersect_cuda(axis), rows * -(-places.shape[1] // _RUN), inputs, [points])
        return
    launch_slabs(_intersect_cpu(axis), rows, slabs(rows, 16 * pixels), inputs, [points])


@lru_cache
def _intersect_cpu(axis: int) -> wp.Kernel:
    native = _native.func_native("_triangulation_cpu.h", AXIS=axis, **_NUMBERS)

    @native
    def intersect_row(
        i: int,
        places: wp.array2d[float],
        valid: wp.array2d[wp.uint8],
        lenses: wp.array2d[float],
        pose: wp.array[float],
        points: wp.array3d[float],
    ): ...

    @wp.kernel(module="unique", module_options=EXACT)
    def intersect_slab(
        slab: int,
        first: int,
        last: int,
        places: wp.array2d[float],  # (H, W)
        valid: wp.array2d[wp.uint8],  # (H, W), or (1, 1)
        lenses: wp.array2d[float],  # (2, 9)
        pose: wp.array[float],  # (12,)
        # outputs
        points: wp.array3d[float],  # (H, W, 3)
    ):
        for i in range(first, last):
            intersect_row(i, places, valid, lenses, pose, points)

    return intersect_slab


@lru_cache
def _intersect_cuda(axis: int) -> wp.Kernel:
    @_native.kernel("_triangulation_cuda.cu", OPTIONS, AXIS=axis, RUN=_RUN, **_NUMBERS)
    def intersect_run(
        places: wp.array2d[float],
        valid: wp.array2d[wp.uint8],
        lenses: wp.array2d[float],
        pose: wp.array[float],
        points: wp.array3d[float],
    ): ...

    return intersect_run
