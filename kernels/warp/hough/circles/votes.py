"""Votes for circles, in Warp: a thread takes a slab of rows of the accumulator, or words of a row.

A pixel votes for the centres of all circles through it, or only for those along its gradient
(Kimme, Ballard and Sklansky, "Finding circles by an array of accumulators", CACM 1975).
"""

import warp as wp

from cvkern.kernels.codes.hough import Rings
from cvkern.kernels.warp._launch import launch, launch_slabs, scratch, slabs, view
from cvkern.kernels.warp._structs import struct_of
from cvkern.kernels.warp.hough._points_cpu import words

from . import _votes_cpu as cpu
from . import _votes_cuda as cuda

_SLABS = 4  # slabs per thread, because rows of small rings take less time


def vote_rings(mask: wp.array, rings: Rings, reach: int, votes: wp.array) -> None:
    """Cast a vote for each offset of each ring from each set pixel; fill all votes.

    `votes`, (R, H + 2 pad, W + 2 pad), are int32, or float32 for shares of the ring. Of a stack,
    masks and votes have one more axis.
    """
    if mask.ndim == 3 and not mask.device.is_cuda:
        for n in range(mask.shape[0]):
            vote_rings(mask[n], rings, reach, votes[n])
        return
    shares, votes = _integers(votes)
    images, height, width = (1, *mask.shape)[-3:]
    pad = (votes.shape[2] - width) // 2
    top = pad + reach
    count = rings.offsets.shape[0]
    if mask.device.is_cuda:
        left = -(-top // 32) * 32
        across = -(-votes.shape[2] // 32)
        shape = (images, height + 2 * top + 1, across + (left + reach) // 32 + 2)
        mask = view(mask, wp.uint8, (images, height, width))
        bits = scratch("circles.bits", shape, wp.uint32, mask.device)
        places = scratch("circles.places", (count,), wp.uint32, mask.device)
        launch(cuda.pack, _in_blocks(32 * bits.size), [mask, top, left], [bits])
        launch(cuda.place, count, [rings.offsets, reach, left - pad, bits], [places])
        items = across * -(-votes.shape[1] // cuda.ROWS)
        launch(
            cuda.vote_rings,
            votes.shape[0] * _in_blocks(items),
            [bits, places, rings.starts, shares],
            [votes],
        )
        return
    left = -(-top // 8) * 8
    lanes = -(-votes.shape[2] // cpu.LANES) * cpu.LANES
    shape = (8, height + 2 * top, (lanes + left + reach) // 64 * 8 + 8)
    bits = scratch("circles.bits", shape, wp.uint8, mask.device)
    places = scratch("circles.places", (count,), wp.int64, mask.device)
    bit_words = view(bits, wp.uint64, (*shape[:2], shape[2] // 8))
    inputs = [mask, words(mask), top, left]
    launch_slabs(cpu.pack, shape[1], slabs(shape[1], bits.size), inputs, [bits, bit_words])
    launch(cpu.place, 1, [rings.offsets, reach, left - pad, bits], [places])
    lines = votes.shape[0] * votes.shape[1]
    launch_slabs(
        cpu.vote_rings, lines, _pieces(lines, votes), [bits, places, rings.starts, shares], [votes]
    )


def vote_directed(
    points: wp.array,
    starts: wp.array,
    orientation: wp.array,
    rings: Rings,
    directions: wp.array,
    tolerance: int,
    votes: wp.array,
) -> None:
    """Cast the votes of `vote_rings` that lie along the gradient; fill all votes.

    Without a tolerance (-1) a point votes for the two pixels at one radius along its direction.
    Otherwise it votes, on both sides, for the offsets whose direction codes differ from its own by
    at most the tolerance. The points of a stack have the rows of all its images.
    """
    stack = None if orientation.ndim == 2 else orientation.shape
    shares, votes = _integers(votes)
    if votes.device.is_cuda:
        flat = view(votes, wp.int32, (votes.size,))
        launch(cuda.clear, votes.size, [], [flat])
        if stack:
            orientation = view(orientation, wp.float32, (stack[0] * stack[1], stack[2]))
        radii, *listed = rings
        inputs = [points, starts, orientation, radii, directions, tolerance, *listed]
        launch(cuda.vote_directed, points.shape[0], inputs, [votes])
        if shares:
            plane = votes.shape[1] * votes.shape[2]
            launch(cuda.share, votes.size, [rings.starts, plane], [flat])
        return
    circles = struct_of(cpu.Circles, rings)
    number, lines = rings.radii.shape[0], rings.radii.shape[0] * votes.shape[1]
    for n in range(stack[0] if stack else 1):
        first = n * stack[1] if stack else 0
        of_image = starts[first : first + stack[1] + 1] if stack else starts
        angles = orientation[n] if stack else orientation
        filled = votes[n * number : (n + 1) * number] if stack else votes
        inputs = [points, of_image, angles, directions, tolerance, circles, shares, first]
        launch_slabs(cpu.vote_directed, lines, _pieces(lines, filled), inputs, [filled])


def _integers(votes: wp.array) -> tuple[bool, wp.array]:
    """Tell whether the votes are shares; view their memory as integers, one plane a ring."""
    planes = votes.size // (votes.shape[-2] * votes.shape[-1])
    return votes.dtype is wp.float32, view(votes, wp.int32, (planes, *votes.shape[-2:]))


def _pieces(count: int, votes: wp.array) -> int:
    some = slabs(count, votes.size)
    return min(count, _SLABS * some) if some > 1 else 1


def _in_blocks(threads: int) -> int:
    return -(-threads // cuda.BLOCK) * cuda.BLOCK
