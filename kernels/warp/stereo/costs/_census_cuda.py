"""Census and Hamming distance on CUDA: one thread per pixel, and threads along the disparities.

census.py describes the transform. The code of the distances is native, so that a block stores those
of a tile in order. Semi-global matching has a census of its own, because the kernel of any window
took 91 us for 1080p on an H200: a thread takes the four bytes of a word. The mean of a byte and of
255 minus another one, rounded down, has its highest bit where the other one is less.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from cvkern.kernels.warp import _native
from cvkern.kernels.warp._launch import launch, view

from ._windows_cpu import OPTIONS

_BLOCK = 256
_TILE = 16  # pixels whose distances a block computes


@lru_cache
def census_kernel(scalar: Any, symmetric: bool) -> wp.Kernel:
    """Return the kernel of a census of values of one type; it is compiled at the first use."""

    @wp.kernel(module="unique", module_options=OPTIONS)
    def census(
        image: wp.array3d[scalar],  # (H, W, C)
        radius_y: int,
        radius_x: int,
        spacing: int,
        # outputs
        bits: wp.array3d[wp.uint64],  # (H, W, C)
    ):
        y, x, c = wp.tid()
        last_y = image.shape[0] - 1
        last_x = image.shape[1] - 1
        word = wp.uint64(0)
        n = wp.uint64(0)
        centre = image[y, x, c]
        for dy in range(-radius_y, radius_y + 1):
            v = wp.clamp(y + dy * spacing, 0, last_y)
            for dx in range(-radius_x, radius_x + 1):
                u = wp.clamp(x + dx * spacing, 0, last_x)
                if wp.static(symmetric):
                    if dy < 0 or (dy == 0 and dx < 0):
                        opposite_v = wp.clamp(y - dy * spacing, 0, last_y)
                        opposite_u = wp.clamp(x - dx * spacing, 0, last_x)
                        if image[v, u, c] < image[opposite_v, opposite_u, c]:
                            word = word | (wp.uint64(1) << n)
                        n += wp.uint64(1)
                else:
                    if dy != 0 or dx != 0:
                        if image[v, u, c] < centre:
                            word = word | (wp.uint64(1) << n)
                        n += wp.uint64(1)
        bits[y, x, c] = word

    return census


@lru_cache
def census_of_24(aligned: bool) -> wp.Kernel:
    """Return the kernel for the 24 neighbours of bytes: of rows of words, or of rows of bytes."""

    @wp.func
    def word_of(image: wp.array2d[wp.uint8], v: int, x: int):
        """Return the four bytes from column x on; the border is repeated."""
        word = wp.uint32(0)
        for k in range(4):
            u = wp.clamp(x + k, 0, image.shape[1] - 1)
            word = word | wp.uint32(image[v, u]) << wp.uint32(8 * k)
        return word

    @wp.func
    def part_of(low: wp.uint32, high: wp.uint32, first: int):
        """Return the four bytes from byte `first` of two words on."""
        both = wp.uint64(high) << wp.uint64(32) | wp.uint64(low)
        return wp.uint32(both >> wp.uint64(8 * first))

    @wp.kernel(module="unique", module_options=OPTIONS)
    def census_of_24(
        image: wp.array2d[wp.uint32 if aligned else wp.uint8],
        # outputs
        bits: wp.array2d[wp.uint64],  # (H, W)
    ):
        y, group = wp.tid()
        last_y = image.shape[0] - 1
        x = 4 * group
        columns = bits.shape[1]
        # Bytes of neighbours 0 to 7, 8 to 15 and 16 to 23 of each of the four pixels.
        first = wp.uint32(0)
        second = wp.uint32(0)
        third = wp.uint32(0)
        if wp.static(aligned):
            middle = image[y, group]
        else:
            middle = word_of(image, y, x)
        for i in range(5):
            v = wp.clamp(y + i - 2, 0, last_y)
            if wp.static(aligned):
                here = image[v, group]
                before = image[v, wp.max(group - 1, 0)]
                after = image[v, wp.min(group + 1, image.shape[1] - 1)]
                if x == 0:
                    before = (here & wp.uint32(255)) * wp.uint32(0x1010101)
                if x == columns - 4:
                    after = (here >> wp.uint32(24)) * wp.uint32(0x1010101)
            else:
                here = word_of(image, v, x)
                before = word_of(image, v, x - 4)
                after = word_of(image, v, x + 4)
            for j in range(5):
                if wp.static(i != 2 or j != 2):
                    n = wp.static(5 * i + j - int(5 * i + j > 12))
                    other = here
                    if wp.static(j < 2):
                        other = part_of(before, here, j + 2)
                    if wp.static(j > 2):
                        other = part_of(here, after, j - 2)
                    apart = (middle ^ ~other) >> wp.uint32(1) & wp.uint32(0x7F7F7F7F)
                    mean = (middle & ~other) + apart
                    less = mean >> wp.uint32(7) & wp.uint32(0x1010101)
                    if wp.static(n < 8):
                        first = first | less << wp.uint32(n)
                    elif wp.static(n < 16):
                        second = second | less << wp.uint32(n - 8)
                    else:
                        third = third | less << wp.uint32(n - 16)
        for k in range(4):
            if wp.static(aligned) or x + k < columns:
                shift = wp.uint32(8 * k)
                byte = wp.uint32(255)
                word = first >> shift & byte
                word = word | (second >> shift & byte) << wp.uint32(8)
                word = word | (third >> shift & byte) << wp.uint32(16)
                bits[y, x + k] = wp.uint64(word)

    return census_of_24


@_native.kernel("_census_cuda.cu", OPTIONS, BLOCK=_BLOCK, TILE=_TILE)
def distances(
    left: wp.array3d[wp.uint64],  # (H, W, C)
    right: wp.array3d[wp.uint64],  # (H, W, C)
    first: int,
    # outputs
    costs: wp.array3d[wp.uint8],  # (H, W, D)
): ...


def census(
    image: wp.array, radius_y: int, radius_x: int, spacing: int, symmetric: bool, bits: wp.array
) -> None:
    """Launch a thread for each value; for bytes and the 24 neighbours of matching, for four."""
    usual = radius_y == radius_x == 2 and spacing == 1 and not symmetric
    if usual and image.dtype is wp.uint8 and image.shape[2] == 1:
        height, width, _ = image.shape
        aligned = width % 4 == 0 and image.ptr % 4 == 0
        scalar, columns = (wp.uint32, width // 4) if aligned else (wp.uint8, width)
        rows = view(image, scalar, (height, columns))
        threads = height, -(-width // 4)
        launch(census_of_24(aligned), threads, [rows], [view(bits, wp.uint64, (height, width))])
        return
    inputs = [image, radius_y, radius_x, spacing]
    launch(census_kernel(image.dtype, bool(symmetric)), image.shape, inputs, [bits])


def hamming(left: wp.array, right: wp.array, first: int, costs: wp.array) -> None:
    """Launch a block for each tile of a row."""
    blocks = left.shape[0] * -(-left.shape[1] // _TILE)
    launch(distances, blocks * _BLOCK, [left, right, first], [costs])
