"""Channels of colour images, in Warp: one thread per slab of pixels, or per pixel on CUDA.

The gradient of a colour image at a pixel is that of the channel where it is longest; of equal ones,
the first channel's (as in cv2.Canny).
"""

from typing import Any

import warp as wp

from cvkern.kernels.codes.edges import Norm
from cvkern.kernels.warp._launch import launch_each

# Without fused multiply-add a length has the same bits on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False})


def _split(scalar: Any) -> wp.Kernel:
    """Return the kernel for values of one type."""

    @wp.kernel
    def split(
        stride: int,
        first: int,
        last: int,
        src: wp.array3d[scalar],  # (H, W, C)
        # outputs
        planes: wp.array3d[scalar],  # (K, H, W), K <= C
    ):
        width = src.shape[1]
        for i in range(first + wp.tid(), last, stride):
            y = i // width
            x = i - y * width
            for c in range(planes.shape[0]):
                planes[c, y, x] = src[y, x, c]

    return split


_split_of = {scalar: _split(scalar) for scalar in (wp.uint8, wp.float32)}


def split(src: wp.array, planes: wp.array) -> None:
    """Copy the first channels of an image, uint8 or float32, to planes."""
    height, width = planes.shape[1:]
    launch_each(_split_of[src.dtype], height * width, planes.size, [src], [planes])


@wp.func
def _length(dy: float, dx: float, norm: int) -> float:
    """Return the length of a gradient, or its square."""
    return wp.where(norm == Norm.L1, wp.abs(dx) + wp.abs(dy), dx * dx + dy * dy)


@wp.kernel
def _longest(
    stride: int,
    first: int,
    last: int,
    dys: wp.array3d[float],  # (K, H, W)
    dxs: wp.array3d[float],  # (K, H, W)
    norm: int,
    # outputs
    dy: wp.array2d[float],  # (H, W)
    dx: wp.array2d[float],  # (H, W)
):
    width = dy.shape[1]
    for i in range(first + wp.tid(), last, stride):
        y = i // width
        x = i - y * width
        down = dys[0, y, x]
        along = dxs[0, y, x]
        most = _length(down, along, norm)
        for c in range(1, dys.shape[0]):
            length = _length(dys[c, y, x], dxs[c, y, x], norm)
            if length > most:
                most = length
                down = dys[c, y, x]
                along = dxs[c, y, x]
        dy[y, x] = down
        dx[y, x] = along


def longest(dys: wp.array, dxs: wp.array, norm: int, dy: wp.array, dx: wp.array) -> None:
    """Take each pixel's gradient from the channel where it is longest, the first of equal ones."""
    launch_each(_longest, dy.size, dys.size, [dys, dxs, norm], [dy, dx])
