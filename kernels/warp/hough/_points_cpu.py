"""The set pixels of a mask as a list, on the CPU: one thread per slab of rows, 8 pixels at a time.

There are two passes. A prefix sum of the number of set pixels of each row gives the place of the
row's points in the list; then each row writes its points. A word of 64 bits holds eight pixels. Let
L be the word whose bytes are 127. Then the highest bit of each byte of ``(((w & L) + L) | w)``
tells whether the byte is not 0, and a product with a word whose bytes are 1 counts these bits.
"""

import warp as wp

from cvkern.kernels.warp._launch import view

wp.set_module_options({"enable_backward": False})

LOWER = wp.constant(wp.uint64(0x7F7F7F7F7F7F7F7F))
HIGHEST = wp.constant(wp.uint64(0x8080808080808080))
ONES = wp.constant(wp.uint64(0x0101010101010101))
NOTHING = wp.constant(wp.uint64(0))


def words(mask: wp.array) -> wp.array:
    """View eight pixels, beginning at each pixel of a row, as a word; the words overlap."""
    height, width = mask.shape
    return view(mask, wp.uint64, (height, max(width - 7, 0)), (width, 1))


@wp.func
def number_of_set(word: wp.uint64) -> int:
    """Return the number of the eight bytes that are not 0."""
    highest = (((word & LOWER) + LOWER) | word) & HIGHEST
    return int(((highest >> wp.uint64(7)) * ONES) >> wp.uint64(56))


@wp.kernel
def count(
    slab: int,
    first: int,
    last: int,
    mask: wp.array2d[wp.uint8],  # (H, W)
    words: wp.array2d[wp.uint64],  # (H, W - 7)
    # outputs
    starts: wp.array[int],  # (H + 1,): for now the number in each row, one place later
):
    for y in range(first, last):
        number = int(0)
        whole = mask.shape[1] // 8 * 8
        for x in range(0, whole, 8):
            number += number_of_set(words[y, x])
        for x in range(whole, mask.shape[1]):
            if mask[y, x] != wp.uint8(0):
                number += 1
        starts[y + 1] = number


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
