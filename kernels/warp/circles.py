"""Votes for circles, in Warp."""

import warp as wp

from . import _circles_rows as rows
from ._launch import launch, launch_slabs, scratch, slabs, view

_SLABS = 4  # a thread: rows of small rings are done sooner


def vote_rings(
    mask: wp.array, offsets: wp.array, starts: wp.array, reach: int, votes: wp.array
) -> None:
    """Cast a vote for each offset of each ring from each set pixel; write all votes.

    `votes`, (R, H + 2 pad, W + 2 pad), are int32, or float32 for shares of the ring.
    """
    shares, votes = _integers(votes)
    pad = (votes.shape[2] - mask.shape[1]) // 2
    top = pad + reach
    left = -(-top // 8) * 8
    width = -(-votes.shape[2] // rows.LANES) * rows.LANES
    pitch = (width + left + reach) // 64 * 8 + 8
    bits = scratch("circles.bits", (8, mask.shape[0] + 2 * top, pitch), wp.uint8, mask.device)
    places = scratch("circles.places", (offsets.shape[0],), wp.int32, mask.device)
    height = bits.shape[1]
    launch_slabs(rows.pack, height, slabs(height, bits.size), [mask, top, left], [bits])
    launch(rows.place, 1, [offsets, reach, left - pad, bits], [places])
    count = votes.shape[0] * votes.shape[1]
    launch_slabs(
        rows.vote_rings, count, _pieces(count, votes), [bits, places, starts, shares], [votes]
    )


def vote_directed(
    points: wp.array,
    starts: wp.array,
    orientation: wp.array,
    radii: wp.array,
    directions: wp.array,
    tolerance: int,
    offsets: wp.array,
    codes: wp.array,
    offset_starts: wp.array,
    votes: wp.array,
) -> None:
    """Cast the votes of `vote_rings` that lie along the gradient; write all votes.

    Without a tolerance (-1) a point votes for the two pixels a radius away along its direction,
    else for the offsets whose direction codes lie within the tolerance of its own, on both sides.
    """
    shares, votes = _integers(votes)
    count = votes.shape[0] * votes.shape[1]
    launch_slabs(
        rows.vote_directed,
        count,
        _pieces(count, votes),
        [points, starts, orientation, radii, directions, tolerance, offsets, codes, offset_starts,
         shares],
        [votes],
    )  # fmt: skip


def _integers(votes: wp.array) -> tuple[bool, wp.array]:
    """Tell whether shares are asked for, and view the memory as integers."""
    return votes.dtype is wp.float32, view(votes, wp.int32, votes.shape)


def _pieces(count: int, votes: wp.array) -> int:
    some = slabs(count, votes.size)
    return min(count, _SLABS * some) if some > 1 else 1
