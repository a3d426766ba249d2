"""Channels of colour images on CUDA, one thread per pixel."""

from typing import Any

import warp as wp

from cvkern.kernels.codes.edges import Norm

# Without fused multiply-add a length has the same bits on every device.
wp.set_module_options({"enable_backward": False, "fuse_fp": False})


def _split(scalar: Any) -> wp.Kernel:
    """Return the kernel for values of one type."""

    @wp.kernel
    def split(
        src: wp.array3d[scalar],  # (H, W, C)
        # outputs
        planes: wp.array3d[scalar],  # (K, H, W), K <= C
    ):
        i = wp.tid()
        y = i // src.shape[1]
        x = i - y * src.shape[1]
        for c in range(planes.shape[0]):
            planes[c, y, x] = src[y, x, c]

    return split


splits = {scalar: _split(scalar) for scalar in (wp.uint8, wp.float32)}


@wp.func
def length(dy: float, dx: float, norm: int) -> float:
    """Return the length of a gradient, or its square."""
    return wp.where(norm == Norm.L1, wp.abs(dx) + wp.abs(dy), dx * dx + dy * dy)


@wp.kernel
def longest(
    dys: wp.array3d[float],  # (K, H, W)
    dxs: wp.array3d[float],  # (K, H, W)
    norm: int,
    # outputs
    dy: wp.array2d[float],  # (H, W)
    dx: wp.array2d[float],  # (H, W)
):
    i = wp.tid()
    y = i // dy.shape[1]
    x = i - y * dy.shape[1]
    down = dys[0, y, x]
    along = dxs[0, y, x]
    most = length(down, along, norm)
    for c in range(1, dys.shape[0]):
        other = length(dys[c, y, x], dxs[c, y, x], norm)
        if other > most:
            most = other
            down = dys[c, y, x]
            along = dxs[c, y, x]
    dy[y, x] = down
    dx[y, x] = along
