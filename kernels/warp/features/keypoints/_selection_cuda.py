"""The selection of the best on CUDA, by one block.

The code (_selection_cuda.cu) is native, for shared memory: the host need not know how many points
there are before the next kernel.
"""

import warp as wp

from cvkern.kernels.warp import _native

# Blocks are numbered along one axis.
wp.set_module_options({"enable_backward": False, "fuse_fp": False, "default_grid_stride": False})

THREADS = 1024


@_native.kernel("_selection_cuda.cu", THREADS=THREADS)
def choose(
    values: wp.array[int],
    ranks: wp.array[int],
    ranked: int,
    # outputs
    number: wp.array[int],
    chosen: wp.array[int],
): ...
