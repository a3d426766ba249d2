"""The check against the right image, and the filling of gaps, on the CPU: a thread per slab.

agreement.py and gaps.py have the rules. The code is native, because rows without branches become
vector code.
"""

from typing import Any

import warp as wp

from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


def _left_right(scalar: Any) -> wp.Kernel:
    """Return the kernel for right disparities of one type."""

    @_native.kernel("_rows_cpu.h", TYPE=scalar, INDICES=int(scalar is wp.int32))
    def left_right(
        slab: int,
        begin: int,
        end: int,
        disparity: wp.array2d[float],  # (H, W)
        right: wp.array2d[scalar],  # (H, W)
        first: int,
        tolerance: float,
        # outputs
        checked: wp.array2d[float],  # (H, W)
    ): ...

    return left_right


left_rights = {scalar: _left_right(scalar) for scalar in (wp.int32, wp.float32)}


@_native.kernel("_rows_cpu.h")
def fill(
    slab: int,
    first: int,
    last: int,
    disparity: wp.array2d[float],  # (H, W)
    # outputs
    filled: wp.array2d[float],  # (H, W)
    valid: wp.array2d[wp.uint8],  # (H, W)
    found: wp.array[int],  # (H,) whether a row has any
): ...
