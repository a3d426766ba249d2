"""Bilinear demosaicing of integers on the CPU, in native code: one thread a slab of rows."""

from typing import Any

import warp as wp

from cvkern.kernels.warp import _native

LANES = 32  # pixels at once
_OPTIONS = {"enable_backward": False, "fuse_fp": False}


def _places(values: Any) -> str:
    return ", ".join(str(value) for value in values)


# Three vectors of a colour each become three vectors of pixels: the first two are joined before.
_ORDER = [k % 3 * LANES + k // 3 for k in range(3 * LANES)]
_THIRDS = [_places(_ORDER[k * LANES : (k + 1) * LANES]) for k in range(3)]
_SHUFFLES = {
    "BOTH": _places(range(2 * LANES)),
    "TWICE": _places([*range(LANES)] * 2),
    "FIRST_THIRD": _THIRDS[0],
    "SECOND_THIRD": _THIRDS[1],
    "LAST_THIRD": _THIRDS[2],
}


def _average(scalar: Any, wider: Any) -> wp.Kernel:
    """Return the kernel for samples of one type, whose sums fit into a wider one."""

    @_native.kernel("_bilinear_cpu.h", _OPTIONS, TYPE=scalar, SUM=wider, LANES=LANES, **_SHUFFLES)
    def average(
        slab: int,
        first: int,
        last: int,
        raw: wp.array2d[scalar],
        red_row: int,
        red_column: int,
        # outputs
        colours: wp.array3d[scalar],
    ): ...

    return average


averages = {
    wp.uint8: _average(wp.uint8, wp.uint16),
    wp.uint16: _average(wp.uint16, wp.uint32),
}
