"""Channels of colour images, in Warp: one thread per slab of rows, or per pixel on CUDA.

The gradient of a colour image at a pixel is that of the channel where it is longest; of equal ones,
the first channel's (as in cv2.Canny).
"""

import warp as wp

from cvkern.kernels.warp._launch import launch, launch_slabs, slabs

from . import _channels_cpu as cpu
from . import _channels_cuda as cuda


def split(src: wp.array, planes: wp.array) -> None:
    """Copy the first channels of an image, uint8 or float32, to planes."""
    height, width = planes.shape[1:]
    if planes.device.is_cuda:
        launch(cuda.splits[src.dtype], height * width, [src], [planes])
        return
    count = slabs(height, planes.size)
    launch_slabs(cpu.splits[src.dtype], height, count, [src], [planes])


def longest(dys: wp.array, dxs: wp.array, norm: int, dy: wp.array, dx: wp.array) -> None:
    """Take each pixel's gradient from the channel where it is longest, the first of equal ones."""
    if dy.device.is_cuda:
        launch(cuda.longest, dy.size, [dys, dxs, norm], [dy, dx])
        return
    height = dy.shape[0]
    launch_slabs(cpu.longest, height, slabs(height, dys.size), [dys, dxs, norm], [dy, dx])
