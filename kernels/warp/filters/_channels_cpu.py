"""Channels of colour images on the CPU: one thread per slab of rows, in vectors of pixels."""

from typing import Any

import warp as wp

from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


def _split(scalar: Any) -> wp.Kernel:
    """Return the kernel for values of one type."""

    @_native.kernel("_channels_cpu.h", SCALAR=scalar)
    def split(
        slab: int,
        first: int,
        last: int,
        src: wp.array3d[scalar],  # (H, W, C)
        # outputs
        planes: wp.array3d[scalar],  # (K, H, W), K <= C
    ): ...

    return split


splits = {scalar: _split(scalar) for scalar in (wp.uint8, wp.float32)}


@_native.kernel("_channels_cpu.h")
def longest(
    slab: int,
    first: int,
    last: int,
    dys: wp.array3d[float],  # (K, H, W)
    dxs: wp.array3d[float],  # (K, H, W)
    norm: int,
    # outputs
    dy: wp.array2d[float],  # (H, W)
    dx: wp.array2d[float],  # (H, W)
): ...
