"""Winner takes all on CUDA: a group of threads per left pixel, a block per tile of right pixels.

_winner.h has the rule. The threads of a pixel load its costs 16 bytes at a time if they are
aligned, and find the smallest cost and its rival by shuffles. The code is native for these loads
and shuffles.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.stereo import Rule, Winners
from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import launch
from cvkern.kernels.warp._structs import struct_of

from ._winner import CURVES, OPTIONS, WinnerArrays, WinnerRule

BLOCK = 256  # threads of a block


def _constants(scalar: Any) -> dict[str, Any]:
    floats = scalar is wp.float32
    wide, most = (wp.float32, "__int_as_float(0x7f800000)") if floats else (wp.int32, "0x7fffffff")
    return {"TYPE": scalar, "WIDE": wide, "MOST": most, "BLOCK": BLOCK, **CURVES}


@lru_cache
def pick_kernel(scalar: Any, lanes: int, vector: int) -> wp.Kernel:
    """Return the kernel for one type, `lanes` threads per pixel and `vector` costs per load."""
    constants = {**_constants(scalar), "LANES": lanes, "VECTOR": vector}

    @_native.kernel("_winners_cuda.cu", OPTIONS, **constants)
    def pick(
        costs: wp.array3d[scalar],  # (H, W, D)
        rule: WinnerRule,
        # outputs
        winners: WinnerArrays,
    ): ...

    return pick


@lru_cache
def pick_right_kernel(scalar: Any) -> wp.Kernel:
    """Return the kernel for costs of one type."""

    @_native.kernel("_winners_cuda.cu", OPTIONS, **_constants(scalar))
    def pick_right(
        costs: wp.array3d[scalar],  # (H, W, D)
        first: int,
        # outputs
        index: wp.array2d[int],  # (H, W)
    ): ...

    return pick_right


def pick(costs: wp.array, rule: Rule, winners: Winners) -> None:
    """Find the smallest cost of each pixel, its sub-pixel disparity, and the confidence."""
    depth = costs.shape[2]
    vector = 16 // wp.types.type_size_in_bytes(costs.dtype)
    if depth % vector != 0 or costs.ptr % 16 != 0:
        vector = 1
    lanes = 1
    while lanes < 32 and 2 * lanes * vector < depth:
        lanes *= 2
    launch(
        pick_kernel(costs.dtype, lanes, vector),
        -(-winners.index.size * lanes // BLOCK) * BLOCK,
        [costs, struct_of(WinnerRule, rule)],
        [struct_of(WinnerArrays, winners)],
    )


def pick_right(costs: wp.array, first: int, index: wp.array) -> None:
    """Find the smallest cost of each right pixel, on the diagonals of the volume."""
    height, width = index.shape
    threads = height * -(-width // BLOCK) * BLOCK
    launch(pick_right_kernel(costs.dtype), threads, [costs, first], [index])
