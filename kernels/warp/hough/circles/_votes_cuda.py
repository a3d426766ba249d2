"""Votes for circles on CUDA.

As on the CPU, the votes of a ring are sums of moved masks with one bit per pixel. A thread adds 32
pixels at once, in two rows; full adders reduce three bits to two. Along the gradient, a point has
few votes, and these are added one by one, one thread per point.
"""

import warp as wp

from cvkern.kernels.codes.hough import DIRECTIONS
from cvkern.kernels.warp import _native
from cvkern.kernels.warp.hough._directions import direction_code

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BLOCK = 256  # threads of a block; Warp's own
ROWS = 2  # rows of a thread
HALF_TURN = wp.constant(DIRECTIONS // 2)
LAST = wp.constant(DIRECTIONS - 1)


@_native.kernel("_votes_cuda.cu", BLOCK=BLOCK)
def pack(
    mask: wp.array3d[wp.uint8],  # (N, H, W)
    top: int,
    left: int,
    # outputs
    bits: wp.array3d[wp.uint32],  # (N, H + 2 top + 1, pitch)
): ...


@wp.kernel
def place(
    offsets: wp.array2d[int],  # (N, 2)
    top: int,
    left: int,
    bits: wp.array3d[wp.uint32],
    # outputs
    places: wp.array[wp.uint32],  # (N,)
):
    """Return the place at which the words moved by an offset begin: 27 bits word, 5 bits bit."""
    i = wp.tid()
    column = left + offsets[i, 1]
    word = (top + offsets[i, 0]) * bits.shape[2] + column // 32
    places[i] = wp.uint32(word) * wp.uint32(32) + wp.uint32(column % 32)


@_native.kernel("_votes_cuda.cu", BLOCK=BLOCK)
def vote_rings(
    bits: wp.array3d[wp.uint32],  # (N, H + 2 top + 1, pitch)
    places: wp.array[wp.uint32],  # (N,)
    starts: wp.array[int],  # (R + 1,)
    shares: bool,
    # outputs
    votes: wp.array3d[int],  # (N R, H + 2 pad, W + 2 pad), of float32 if `shares`
): ...


@wp.kernel
def clear(
    # outputs
    votes: wp.array[int],
):
    votes[wp.tid()] = 0


@wp.func
def vote(votes: wp.array3d[int], ring: int, y: int, x: int):
    """Add one vote, if it is inside."""
    if y >= 0 and x >= 0 and y < votes.shape[1] and x < votes.shape[2]:
        wp.atomic_add(votes, ring, y, x, 1)


@wp.kernel
def vote_directed(
    points: wp.array2d[int],  # (N, 2)
    starts: wp.array[int],  # (H + 1,)
    orientation: wp.array2d[float],  # (N H, W)
    radii: wp.array[int],  # (R,)
    directions: wp.array2d[int],  # (DIRECTIONS, 2)
    tolerance: int,
    offsets: wp.array2d[int],  # (M, 2)
    codes: wp.array[int],  # (M,)
    offset_starts: wp.array[int],  # (R + 1,)
    # outputs
    votes: wp.array3d[int],  # (N R, H + 2 pad, W + 2 pad)
):
    # One thread per point; the host does not know the number of points.
    i = wp.tid()
    if i >= starts[starts.shape[0] - 1]:
        return
    pad = (votes.shape[2] - orientation.shape[1]) // 2
    number = radii.shape[0]
    height = orientation.shape[0] * number // votes.shape[0]
    image = points[i, 0] // height
    y = points[i, 0] - image * height + pad
    x = points[i, 1] + pad
    code = direction_code(orientation[points[i, 0], points[i, 1]])
    for ring in range(number):
        plane = image * number + ring
        if tolerance < 0:
            down = (radii[ring] * directions[code, 0] + 32768) >> 16
            along = (radii[ring] * directions[code, 1] + 32768) >> 16
            vote(votes, plane, y + down, x + along)
            vote(votes, plane, y - down, x - along)
        else:
            begin = offset_starts[ring]
            size = offset_starts[ring + 1] - begin
            for side in range(2):
                least = (code + side * HALF_TURN - tolerance) & LAST
                low = int(0)  # becomes the first offset whose code is not below `least`
                high = size
                while low < high:
                    middle = (low + high) // 2
                    if codes[begin + middle] < least:
                        low = middle + 1
                    else:
                        high = middle
                for k in range(size):
                    at = begin + (low + k) % size
                    if ((codes[at] - least) & LAST) > 2 * tolerance:
                        break
                    vote(votes, plane, y + offsets[at, 0], x + offsets[at, 1])


@wp.kernel
def share(
    offset_starts: wp.array[int],  # (R + 1,)
    plane: int,
    # outputs
    votes: wp.array[int],  # (N R plane,), then of float32
):
    i = wp.tid()
    ring = i // plane % (offset_starts.shape[0] - 1)
    size = offset_starts[ring + 1] - offset_starts[ring]
    votes[i] = wp.cast(float(votes[i]) / float(size), wp.int32)
