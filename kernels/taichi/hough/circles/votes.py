"""Votes for circles in Taichi: one thread per set pixel, which adds its votes by atomics.

A pixel votes for the centres of all circles through it, or only for those along its gradient
(Kimme, Ballard and Sklansky, "Finding circles by an array of accumulators", CACM 1975).
"""

import numpy as np
import taichi as ti

from cvkern.kernels.codes.hough import DIRECTIONS, Rings
from cvkern.kernels.taichi._launch import primitive, scratch
from cvkern.kernels.taichi._rounding import quotient
from cvkern.kernels.taichi.hough._directions import direction_code

f32_2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
f32_3 = ti.types.ndarray(dtype=ti.f32, ndim=3)
i32_1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
i32_2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
i32_3 = ti.types.ndarray(dtype=ti.i32, ndim=3)
u8_3 = ti.types.ndarray(dtype=ti.u8, ndim=3)


@ti.func
def _vote(votes: ti.template(), ring: ti.i32, y: ti.i32, x: ti.i32):
    if 0 <= y < votes.shape[1] and 0 <= x < votes.shape[2]:
        ti.atomic_add(votes[ring, y, x], 1)


@ti.kernel
def _vote_rings(
    mask: u8_3,  # (N, H, W)
    offsets: i32_2,
    starts: i32_1,
    # outputs
    votes: i32_3,
):
    for ring, y, x in votes:
        votes[ring, y, x] = 0
    pad = (votes.shape[2] - mask.shape[2]) // 2
    number = starts.shape[0] - 1
    for n, y, x in mask:
        if mask[n, y, x] != 0:
            for ring in range(number):
                for k in range(starts[ring], starts[ring + 1]):
                    _vote(
                        votes, n * number + ring, y + pad - offsets[k, 0], x + pad - offsets[k, 1]
                    )


@ti.kernel
def _vote_directed(
    points: i32_2,
    starts: i32_1,
    orientation: f32_2,
    radii: i32_1,
    directions: i32_2,
    tolerance: ti.i32,
    offsets: i32_2,
    codes: i32_1,
    offset_starts: i32_1,
    zero: ti.i32,
    # outputs
    votes: i32_3,  # (N R, H + 2 pad, W + 2 pad)
):
    for plane, y, x in votes:
        votes[plane, y, x] = 0
    pad = (votes.shape[2] - orientation.shape[1]) // 2
    number = radii.shape[0]
    height = orientation.shape[0] * number // votes.shape[0]
    for i in range(starts[starts.shape[0] - 1]):
        n = points[i, 0] // height
        y = points[i, 0] - n * height + pad
        x = points[i, 1] + pad
        code = direction_code(orientation[points[i, 0], points[i, 1]], zero)
        for ring in range(number):
            plane = n * number + ring
            if tolerance < 0:
                down = (radii[ring] * directions[code, 0] + 32768) >> 16
                along = (radii[ring] * directions[code, 1] + 32768) >> 16
                _vote(votes, plane, y + down, x + along)
                _vote(votes, plane, y - down, x - along)
            else:
                for k in range(offset_starts[ring], offset_starts[ring + 1]):
                    for side in range(2):
                        apart = codes[k] - code + side * (DIRECTIONS // 2) + tolerance
                        if (apart & (DIRECTIONS - 1)) <= 2 * tolerance:
                            _vote(votes, plane, y + offsets[k, 0], x + offsets[k, 1])


@ti.kernel
def _share(
    votes: i32_3,
    starts: i32_1,
    zero: ti.i32,
    # outputs
    shares: f32_3,
):
    for plane, y, x in votes:
        ring = plane % (starts.shape[0] - 1)
        size = ti.cast(starts[ring + 1] - starts[ring], ti.f32)
        shares[plane, y, x] = quotient(ti.cast(votes[plane, y, x], ti.f32), size, zero)


def _rings_of_all(votes: np.ndarray) -> np.ndarray:
    """View the planes of all images of a stack, or of one image, one after the other."""
    return votes.reshape((-1, *votes.shape[-2:]))


def _counts(votes: np.ndarray) -> np.ndarray:
    """Return the array for counts: the result itself, unless the result holds shares."""
    return scratch(votes.shape, np.int32) if votes.dtype == np.float32 else votes


@primitive
def vote_rings(mask: np.ndarray, rings: Rings, reach: int, votes: np.ndarray) -> None:
    """Cast a vote for each offset of each ring from each set pixel; one thread per pixel."""
    votes = _rings_of_all(votes)
    counts = _counts(votes)
    _vote_rings(mask.reshape((1, *mask.shape)[-3:]), rings.offsets, rings.starts, counts)
    if counts is not votes:
        _share(counts, rings.starts, 0, votes)


@primitive
def vote_directed(
    points: np.ndarray,
    starts: np.ndarray,
    orientation: np.ndarray,
    rings: Rings,
    directions: np.ndarray,
    tolerance: int,
    votes: np.ndarray,
) -> None:
    """Cast the votes along the gradient; one thread per point."""
    votes = _rings_of_all(votes)
    orientation = orientation.reshape((-1, orientation.shape[-1]))
    counts = _counts(votes)
    radii, offsets, codes, offset_starts = rings
    _vote_directed(
        points, starts, orientation, radii, directions, tolerance, offsets, codes, offset_starts,
        0, counts,
    )  # fmt: skip
    if counts is not votes:
        _share(counts, rings.starts, 0, votes)
