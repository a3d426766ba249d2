"""The check of a disparity map against that of the right image, in Warp.

A disparity d of pixel (y, x) is kept where abs(d - right[y, x - floor(d + 0.5)]) is at most the
tolerance. One thread per pixel on CUDA, per slab of rows on the CPU.
"""

from typing import Any

import warp as wp

from cvkern.kernels.warp._launch import launch, launch_slabs, slabs

from . import _rows_cpu as cpu
from ._none import none

# Without fused multiply-add a disparity has the same bits on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def _itself(value: float, first: int) -> float:
    """Return a disparity unchanged."""
    return value


@wp.func
def _of_index(value: int, first: int) -> float:
    """Return the disparity of an index, NaN for a negative one."""
    return wp.where(value >= 0, float(first + value), none())


def _left_right(scalar: Any, disparity_of: Any) -> wp.Kernel:
    """Return the kernel for right disparities of one type."""

    @wp.kernel
    def left_right(
        disparity: wp.array2d[float],  # (H, W)
        right: wp.array2d[scalar],  # (H, W)
        first: int,
        tolerance: float,
        # outputs
        checked: wp.array2d[float],  # (H, W)
    ):
        i = wp.tid()
        width = disparity.shape[1]
        y = i // width
        x = i - y * width
        d = disparity[y, x]
        at = float(x) - wp.floor(d + 0.5)
        kept = none()
        if at >= 0.0 and at < float(width):
            if wp.abs(d - disparity_of(right[y, int(at)], first)) <= tolerance:
                kept = d
        checked[y, x] = kept

    return left_right


_KERNELS = {
    wp.int32: _left_right(wp.int32, _of_index),
    wp.float32: _left_right(wp.float32, _itself),
}


def left_right(
    disparity: wp.array, right: wp.array, first: int, tolerance: float, checked: wp.array
) -> None:
    """Keep the disparities with which the right image agrees.

    `right` holds float32 disparities, or int32 indices of disparities that begin at `first`,
    negative where there is none.
    """
    options = [disparity, right, first, tolerance]
    if checked.device.is_cuda:
        launch(_KERNELS[right.dtype], checked.size, options, [checked])
        return
    height = checked.shape[0]
    kernel = cpu.left_rights[right.dtype]
    launch_slabs(kernel, height, slabs(height, checked.size), options, [checked])
