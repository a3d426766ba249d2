"""Grey values and every second pixel, on both devices."""

import warp as wp

from cvkern.kernels.codes.features import GRAY

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

RED = wp.constant(GRAY[0])
GREEN = wp.constant(GRAY[1])
BLUE = wp.constant(GRAY[2])


@wp.kernel
def gray(
    stride: int,
    first: int,
    last: int,
    src: wp.array3d[float],  # (H, W, C)
    scale: float,
    # outputs
    dst: wp.array2d[float],  # (H, W)
):
    width = dst.shape[1]
    for item in range(first + wp.tid(), last, stride):
        y = item // width
        x = item - y * width
        v = src[y, x, 0]
        if src.shape[2] > 1:
            v = RED * v + GREEN * src[y, x, 1] + BLUE * src[y, x, 2]
        dst[y, x] = v * scale


@wp.kernel
def halved(
    stride: int,
    first: int,
    last: int,
    src: wp.array2d[float],
    # outputs
    dst: wp.array2d[float],
):
    width = dst.shape[1]
    for item in range(first + wp.tid(), last, stride):
        y = item // width
        x = item - y * width
        dst[y, x] = src[2 * y, 2 * x]
