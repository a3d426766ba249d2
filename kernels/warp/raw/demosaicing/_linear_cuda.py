"""Fixed filters of demosaicing on CUDA, in native code: several rows of pixels a thread."""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.raw import Linear
from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import launch
from cvkern.kernels.warp.raw._types import constants

OPTIONS = {"enable_backward": False, "fuse_fp": False}
BOUNDS = 128, 4  # threads of a block, and blocks of a multiprocessor
PART, ROWS = 4, 4  # columns and rows of a thread, even
MOST = 2**23  # threads, which take their parts in turns, so that no launch is folded


def interpolate(
    raw: wp.array, red_row: int, red_column: int, method: int, colours: wp.array
) -> None:
    """Fill in the two colours that each pixel misses."""
    height, width = raw.shape
    warps = -(-height // ROWS) * -(-width // (32 * PART))
    count = min(32 * warps, MOST)
    launch(kernel(raw.dtype, red_row, red_column, method), count, [raw], [colours], BOUNDS[0])


@lru_cache
def kernel(scalar: Any, red_row: int, red_column: int, method: int) -> wp.Kernel:
    """Make the kernel for values of a type and a place of red."""
    names = {
        "RED_ROW": red_row, "RED_COLUMN": red_column, "SHARP": int(method == Linear.MALVAR),
        "PART": PART, "ROWS": ROWS, "WARPS": BOUNDS[0] // 32, **constants(scalar),
    }  # fmt: skip

    @_native.kernel("_linear_cuda.cu", OPTIONS, launch_bounds=BOUNDS, **names)
    def interpolate_block(
        raw: wp.array2d[scalar],
        # outputs
        colours: wp.array3d[scalar],
    ):
        """Forward to the native code."""

    return interpolate_block
