"""Linear colours as bytes of sRGB on the CPU, in native code: one thread a slab of pixels."""

import warp as wp

from cvkern.kernels.codes.color import DARKEST, FIRST
from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@_native.kernel("_spaces_cpu.h", PART=128, DARKEST=f"{DARKEST!r}f", FIRST=FIRST)
def encode_linear(
    slab: int,
    first: int,
    last: int,
    colours: wp.array2d[float],
    numbers: wp.array[float],
    steps: wp.array[int],
    # outputs
    out: wp.array2d[wp.uint8],
): ...
