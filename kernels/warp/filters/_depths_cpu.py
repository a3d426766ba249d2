"""Integers as floats and back, on the CPU: one thread per slab of rows, as vector code."""

from typing import Any

import warp as wp

from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


def _depths(scalar: Any, most: str) -> tuple[wp.Kernel, wp.Kernel]:
    """Return the kernels for integers of one type."""

    @_native.kernel("_depths_cpu.h", SCALAR=scalar)
    def widen(
        slab: int,
        first: int,
        last: int,
        src: wp.array2d[scalar],
        # outputs
        dst: wp.array2d[float],
    ): ...

    @_native.kernel("_depths_cpu.h", SCALAR=scalar, MOST=most)
    def narrow(
        slab: int,
        first: int,
        last: int,
        src: wp.array2d[float],
        # outputs
        dst: wp.array2d[scalar],
    ): ...

    return widen, narrow


_BOTH = {
    wp.uint8: _depths(wp.uint8, "255.0f"),
    wp.uint16: _depths(wp.uint16, "65535.0f"),
}
widens, narrows = ({scalar: both[i] for scalar, both in _BOTH.items()} for i in (0, 1))
