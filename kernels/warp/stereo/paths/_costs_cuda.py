"""The costs of the semi-global matcher on CUDA: 16 pixels by 16 disparities per thread.

matching.py defines the cost.
"""

from functools import lru_cache

import warp as wp

from cvkern.kernels.codes.stereo import CENSUS_WEIGHT, DIFFERENCE_LIMIT, DIFFERENCE_SHIFT, View
from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import launch, scratch

from ._steps_cuda import BLOCK, OPTIONS

wp.set_module_options(OPTIONS)


@lru_cache
def match_costs_kernel(aligned: bool) -> wp.Kernel:
    """Return the kernel for costs with or without aligned chunks."""
    constants = {
        "BLOCK": BLOCK,
        "SHIFT": DIFFERENCE_SHIFT,
        "WEIGHT": CENSUS_WEIGHT,
        "LIMIT": DIFFERENCE_LIMIT,
        "HALF": (255 >> DIFFERENCE_SHIFT) * 0x10001,
        "ALIGNED": int(aligned),
    }

    @_native.kernel("_costs_cuda.cu", OPTIONS, **constants)
    def match_costs(
        words: wp.array3d[wp.uint32],  # (2, H, W)
        first: int,
        depth: int,
        # outputs
        costs: wp.array3d[wp.uint8],  # (H, W, depth or more)
    ): ...

    return match_costs


@_native.kernel("_costs_cuda.cu", OPTIONS)
def pack(
    left_bits: wp.array2d[wp.uint64],
    right_bits: wp.array2d[wp.uint64],
    left: wp.array2d[wp.uint8],
    right: wp.array2d[wp.uint8],
    # outputs
    words: wp.array3d[wp.uint32],  # (2, H, W)
): ...


def match_costs(left: View, right: View, first: int, depth: int, costs: wp.array) -> None:
    """Fill a volume of at least `depth` disparities; further places, up to 16, never win."""
    height, width, padded = costs.shape
    words = scratch("match.words", (2, height, width), wp.uint32, costs.device)
    launch(pack, -(-height * width // 4), [left.bits, right.bits, left.gray, right.gray], [words])
    threads = height * -(-width // 16) * -(-padded // 16)
    aligned = padded % 16 == 0 and costs.ptr % 16 == 0
    launch(
        match_costs_kernel(aligned),
        -(-threads // BLOCK) * BLOCK,
        [words, first, depth],
        [costs],
    )
