"""Linear colours as bytes of sRGB on CUDA, in native code."""

import warp as wp

from cvkern.kernels.codes.color import DARKEST, FIRST, STEPS
from cvkern.kernels.warp import _native

OPTIONS = {"enable_backward": False, "fuse_fp": False}
BLOCK = 512
MOST = 2**18  # threads, which take pixels in turns: each block reads the table once


def threads(groups: int) -> int:
    """Return the threads of whole blocks for so many groups of pixels."""
    return -(-min(groups, MOST) // BLOCK) * BLOCK


@_native.kernel("_spaces_cuda.cu", OPTIONS, DARKEST=f"{DARKEST!r}f", FIRST=FIRST, STEPS=STEPS)
def encode_four(
    colours: wp.array2d[float],
    numbers: wp.array[float],
    steps: wp.array[int],
    # outputs
    out: wp.array2d[wp.uint8],
): ...
