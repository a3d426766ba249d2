"""Integers as floats and back, on CUDA, one thread per element."""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


def _depths(scalar: Any, most: float) -> tuple[wp.Kernel, wp.Kernel]:
    """Return the kernels for integers of one type."""

    @wp.kernel
    def widen(
        src: wp.array[scalar],
        # outputs
        dst: wp.array[float],
    ):
        i = wp.tid()
        dst[i] = float(src[i])

    @wp.kernel
    def narrow(
        src: wp.array[float],
        # outputs
        dst: wp.array[scalar],
    ):
        i = wp.tid()
        value = wp.where(src[i] > 0.0, src[i], 0.0)
        value = wp.where(value < most, value, most)
        dst[i] = scalar(int(wp.rint(value)))

    return widen, narrow


_BOTH = {wp.uint8: _depths(wp.uint8, 255.0), wp.uint16: _depths(wp.uint16, 65535.0)}
widens, narrows = ({scalar: both[i] for scalar, both in _BOTH.items()} for i in (0, 1))
