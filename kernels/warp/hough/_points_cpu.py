"""The set pixels of a mask as a list, on the CPU: one thread per slab of rows.

There are two passes. A prefix sum of the number of set pixels of each row gives the place of the
row's points in the list; then each row writes its points, and skips words of eight empty pixels.
"""

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import view

wp.set_module_options({"enable_backward": False})

NOTHING = wp.constant(wp.uint64(0))


def words(mask: wp.array) -> wp.array:
    """View eight pixels, beginning at each pixel of a row, as a word; the words overlap."""
    height, width = mask.shape
    return view(mask, wp.uint64, (height, max(width - 7, 0)), (width, 1))


@_native.each("_points_cpu.h")
def count(
    y: int,
    mask: wp.array2d[wp.uint8],  # (H, W)
    # outputs
    starts: wp.array[int],  # (H + 1,): for now the number in each row, one place later
): ...


@wp.kernel
def add_up(
    # outputs
    starts: wp.array[int],  # (H + 1,)
):
    starts[0] = 0
    for y in range(1, starts.shape[0]):
        starts[y] = starts[y] + starts[y - 1]


@wp.kernel
def gather(
    slab: int,
    first: int,
    last: int,
    mask: wp.array2d[wp.uint8],  # (H, W)
    words: wp.array2d[wp.uint64],  # (H, W - 7)
    starts: wp.array[int],  # (H + 1,)
    # outputs
    points: wp.array2d[int],  # (capacity, 2)
):
    for y in range(first, last):
        i = starts[y]
        x = int(0)
        while i < starts[y + 1]:
            empty = bool(False)
            if x + 8 <= mask.shape[1]:
                empty = words[y, x] == NOTHING
            if not empty:
                for k in range(x, wp.min(x + 8, mask.shape[1])):
                    if mask[y, k] != wp.uint8(0):
                        points[i, 0] = y
                        points[i, 1] = k
                        i += 1
            x += 8


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
    number = starts[starts.shape[0] - 1]
    found = number
    for i in range(number):
        value = values[points[i, 0], points[i, 1]]
        if not (value >= low and value <= high) and found == number:
            found = i
    index[0] = found
