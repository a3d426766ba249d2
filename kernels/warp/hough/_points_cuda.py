"""The set pixels of a mask as a list, on CUDA: one warp per row, 16 pixels per lane.

As on the CPU, the pixels of each row are counted, one block computes the prefix sum of the counts,
and then each row writes its points. The counts of the lanes before it give a lane its place.
"""

import warp as wp

from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False})

BLOCK = 256  # threads of a block; Warp's own
WARPS = BLOCK // 32


def dim(mask: wp.array) -> int:
    """Return the number of threads: one warp per row, in whole blocks."""
    return -(-mask.shape[0] // WARPS) * BLOCK


def in_words(mask: wp.array) -> bool:
    """Tell whether every row falls into aligned words of 16 bytes."""
    return mask.shape[1] % 16 == 0 and mask.ptr % 16 == 0


@_native.kernel("_points_cuda.cu")
def count(
    mask: wp.array2d[wp.uint8],  # (H, W)
    words: bool,
    # outputs
    starts: wp.array[int],  # (H + 1,): for now the number in each row, one place later
): ...


@_native.kernel("_points_cuda.cu", BLOCK=BLOCK)
def add_up(
    # outputs
    starts: wp.array[int],  # (H + 1,)
): ...


@_native.kernel("_points_cuda.cu")
def gather(
    mask: wp.array2d[wp.uint8],  # (H, W)
    starts: wp.array[int],  # (H + 1,)
    words: bool,
    # outputs
    points: wp.array2d[int],  # (capacity, 2)
): ...


@wp.kernel
def number_of(
    starts: wp.array[int],  # (H + 1,)
    # outputs
    index: wp.array[int],  # (1,)
):
    index[0] = starts[starts.shape[0] - 1]


@wp.kernel
def first_outside(
    points: wp.array2d[int],  # (capacity, 2)
    starts: wp.array[int],  # (H + 1,)
    values: wp.array2d[float],  # (H, W)
    low: float,
    high: float,
    # outputs
    index: wp.array[int],  # (1,)
):
    i = wp.tid()
    if i < starts[starts.shape[0] - 1]:
        value = values[points[i, 0], points[i, 1]]
        if not (value >= low and value <= high):
            wp.atomic_min(index, 0, i)
