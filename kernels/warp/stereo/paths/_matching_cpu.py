"""Semi-global matching of two images on the CPU: costs, sums and winners in two sweeps.

The sweeps are those of _steps_cpu.py, except that each computes the costs of a pixel when it
reaches the pixel (_costs_cpu.h), which takes less time than reading them from memory. The last
sweep adds its sums to those of the others, and picks the winners of both images while the sums are
in the cache (_turned_cpu.h). In a row the blocks come from right to left.
"""

from functools import lru_cache

import warp as wp

from cvkern.kernels.codes.stereo import CENSUS_WEIGHT, DIFFERENCE_LIMIT, DIFFERENCE_SHIFT
from cvkern.kernels.warp import _native
from cvkern.kernels.warp.stereo import _turned_cpu as turned
from cvkern.kernels.warp.stereo._winner import WinnerArrays, WinnerRule

from ._steps_cpu import OPTIONS, Course, Number, Paths, constants, work_of

wp.set_module_options(OPTIONS)

LANES = 32  # pixels whose winners are found at once, and disparities whose sums are added
LINES = 4  # lines of bytes that a row of the right image is unfolded to
_COST = {
    "LINES": LINES,
    "WEIGHT": CENSUS_WEIGHT,
    "SHIFT": DIFFERENCE_SHIFT,
    "LIMIT": DIFFERENCE_LIMIT,
}


@wp.struct
class Pair:
    """The left image, and the right one unfolded."""

    bits: wp.array2d[wp.uint64]  # (H, W)
    gray: wp.array2d[wp.uint8]  # (H, W)
    unfolded: wp.array2d[wp.uint8]  # (LINES H, W + padded)


@wp.struct
class BestRight:
    """The best match so far of each pixel of the right image, and at last its index."""

    cost: wp.array2d[wp.uint16]  # (h, W + LANES)
    place: wp.array2d[wp.uint16]  # (h, W + LANES)
    index: wp.array2d[int]  # (h, W)


@wp.kernel
def unfold(
    slab: int,
    first_row: int,
    last_row: int,
    bits: wp.array2d[wp.uint64],  # (H, W)
    gray: wp.array2d[wp.uint8],  # (H, W)
    first: int,
    # outputs
    unfolded: wp.array2d[wp.uint8],  # (LINES H, W + padded)
):
    # Place n holds column W - 1 - first - n, or the nearest column in the image.
    columns = gray.shape[1]
    for y in range(first_row, last_row):
        for n in range(unfolded.shape[1]):
            x = wp.clamp(columns - 1 - first - n, 0, columns - 1)
            word = bits[y, x]
            unfolded[LINES * y, n] = wp.uint8(word)
            unfolded[LINES * y + 1, n] = wp.uint8(word >> wp.uint64(8))
            unfolded[LINES * y + 2, n] = wp.uint8(word >> wp.uint64(16))
            unfolded[LINES * y + 3, n] = gray[y, x]


@_native.kernel("_volume_cpu.h", OPTIONS, **_COST, SPAN=32)
def match_costs(
    slab: int,
    first_row: int,
    last_row: int,
    bits: wp.array2d[wp.uint64],  # (H, W)
    gray: wp.array2d[wp.uint8],  # (H, W)
    unfolded: wp.array2d[wp.uint8],  # (LINES H, W + padded)
    # outputs
    costs: wp.array3d[wp.uint8],  # (H, W, D)
): ...


@lru_cache
def sweep(paths: Paths, number: Number) -> wp.Kernel:
    """Return the kernel for some paths, with L in numbers that can hold C + P2."""
    work_type = work_of(number)
    needs = {
        **turned.CONSTANTS,
        **constants(paths, number),
        **_COST,
        "LANES": LANES,
        "SPAN": number.vector,  # disparities whose costs are computed at a time
    }

    @_native.kernel("_matching_cpu.h", OPTIONS, **needs)
    def sweep(
        slab: int,
        first_slab: int,
        last_slab: int,
        pair: Pair,
        count: int,
        course: Course,
        rule: WinnerRule,
        # scratch
        work: work_type,
        turned: wp.array2d[wp.uint16],  # (slabs, (2 TILE + 2 LANES) padded)
        sums: wp.array3d[number.total],  # (h, W, padded)
        right: BestRight,
        # outputs, of the rows from the course's `top` on
        winners: WinnerArrays,  # (h, W)
    ): ...

    return sweep
