"""The choice of hypotheses on CUDA: a block, with a thread for each."""

import warp as wp

from cvkern.kernels.codes.recognition import MOST_HYPOTHESES
from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

THREADS = 256  # a power of two
assert MOST_HYPOTHESES <= THREADS


@_native.kernel("_choices_cuda.cu", THREADS=THREADS)
def explain(
    ranked: wp.array2d[int],  # (R, 4)
    savings: wp.array[int],
    shared: wp.array2d[int],  # (R, R)
    starts: wp.array[int],
    least: int,
    # outputs
    found: wp.array2d[int],  # (R + 1, 4)
): ...
