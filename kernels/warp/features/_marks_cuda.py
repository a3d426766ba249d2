"""Listing of marks on CUDA, a warp a row. _marks.py has the rule.

The code (_marks_cuda.cu) is native, because the lanes of a warp add up their counts.
"""

import warp as wp

from cvkern.kernels.warp import _native

# Blocks are numbered along one axis.
wp.set_module_options({"enable_backward": False, "fuse_fp": False, "default_grid_stride": False})

LANES = 32


@_native.kernel("_marks_cuda.cu")
def list_rows(
    octaves: wp.array2d[wp.int64],  # (O, 4)
    words: wp.array[int],
    ends: wp.array[int],  # (rows,)
    # outputs
    cells: wp.array2d[int],  # (N, 4)
): ...
