"""Votes for circles on the CPU, one thread per slab of rows of the accumulator.

The votes of a ring are a sum of copies of the mask, moved by the ring's offsets. A mask has one bit
per pixel, so 512 pixels are added at once: the count of a pixel is a column of bits over a few
vectors, and a full adder reduces three bits to two (a population count after Harley and Seal). The
cost does not grow with the number of set pixels, and no two threads write the same vote. Along the
gradient, a point has few votes, and these are added one by one.
"""

import warp as wp

from cvkern.kernels.codes.hough import DIRECTION_FACTOR, DIRECTIONS
from cvkern.kernels.warp import _native

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

LOWER = wp.constant(wp.uint64(0x7F7F7F7F7F7F7F7F))  # all bits of eight bytes but the highest
HIGHEST = wp.constant(wp.uint64(0x8080808080808080))

LANES = 512  # pixels added at once
TOGETHER = wp.constant(wp.uint64(0x0102040810204080))  # factor that collects 8 bits in one byte


@wp.struct
class Circles:
    """Circles of several radii; see `codes.hough.Rings`."""

    radii: wp.array[int]
    offsets: wp.array2d[int]
    codes: wp.array[int]
    starts: wp.array[int]


@wp.kernel
def pack(
    slab: int,
    first: int,
    last: int,
    mask: wp.array2d[wp.uint8],  # (H, W)
    pixels: wp.array2d[wp.uint64],  # (H, W - 7): eight pixels from each on
    top: int,
    left: int,
    # outputs
    bits: wp.array3d[wp.uint8],  # (8, H + 2 top, pitch)
    words: wp.array3d[wp.uint64],  # (8, H + 2 top, pitch / 8): the same
):
    # Copy s of the mask is shifted by s bits, so any eight pixels are a byte of one of the copies.
    pitch = words.shape[2]
    whole = mask.shape[1] // 8 * 8
    for row in range(first, last):
        for i in range(pitch):
            words[0, row, i] = wp.uint64(0)
        y = row - top
        if y >= 0 and y < mask.shape[0]:
            for x in range(0, whole, 8):
                word = pixels[y, x]
                word = ((((word & LOWER) + LOWER) | word) & HIGHEST) >> wp.uint64(7)
                bits[0, row, (left + x) // 8] = wp.uint8((word * TOGETHER) >> wp.uint64(56))
            for x in range(whole, mask.shape[1]):
                if mask[y, x] != wp.uint8(0):
                    at = (left + x) // 8
                    bits[0, row, at] = bits[0, row, at] | wp.uint8(1 << (x % 8))
        for s in range(1, 8):
            down = wp.uint64(s)
            up = wp.uint64(64) - down
            here = words[0, row, 0]
            for i in range(pitch):
                behind = wp.uint64(0)
                if i + 1 < pitch:
                    behind = words[0, row, i + 1]
                words[s, row, i] = (here >> down) | (behind << up)
                here = behind


@wp.kernel
def place(
    offsets: wp.array2d[int],  # (N, 2)
    top: int,
    left: int,
    bits: wp.array3d[wp.uint8],
    # outputs
    places: wp.array[wp.int64],  # (N,)
):
    """Return the byte at which the bits moved by an offset begin."""
    for i in range(offsets.shape[0]):
        column = left + offsets[i, 1]
        row = (column % 8) * bits.shape[1] + top + offsets[i, 0]
        places[i] = wp.int64(row) * wp.int64(bits.shape[2]) + wp.int64(column // 8)


@_native.kernel("_votes_cpu.h")
def vote_rings(
    slab: int,
    first: int,
    last: int,
    bits: wp.array3d[wp.uint8],  # (8, H + 2 top, pitch)
    places: wp.array[wp.int64],  # (N,)
    starts: wp.array[int],  # (R + 1,)
    shares: bool,
    # outputs
    votes: wp.array3d[int],  # (R, H + 2 pad, W + 2 pad), of float32 if `shares`
): ...


@_native.kernel(
    "_directed_votes_cpu.h", DIRECTIONS=DIRECTIONS, DIRECTION_FACTOR=repr(DIRECTION_FACTOR)
)
def vote_directed(
    slab: int,
    first: int,
    last: int,
    points: wp.array2d[int],  # (N, 2)
    starts: wp.array[int],  # (H + 1,)
    orientation: wp.array2d[float],  # (H, W)
    directions: wp.array2d[int],  # (DIRECTIONS, 2)
    tolerance: int,
    rings: Circles,
    shares: bool,
    lift: int,  # rows of the points above those of their image
    # outputs
    votes: wp.array3d[int],  # (R, H + 2 pad, W + 2 pad), of float32 if `shares`
): ...
