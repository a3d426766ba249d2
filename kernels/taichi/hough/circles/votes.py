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
u8_2 = ti.types.ndarray(dtype=ti.u8, ndim=2)


@ti.func
def _vote(votes: ti.template(), ring: ti.i32, y: ti.i32, x: ti.i32):
    if 0 <= y < votes.shape[1] and 0 <= x < votes.shape[2]:
        ti.atomic_add(votes[ring, y, x], 1)


@ti.kernel
def _vote_rings(
    mask: u8_2,
    offsets: i32_2,
    starts: i32_1,
    # outputs
    votes: i32_3,
):
    for ring, y, x in votes:
        votes[ring, y, x] = 0
    pad = (votes.shape[2] - mask.shape[1]) // 2
    for y, x in mask:
        if mask[y, x] != 0:
            for ring in range(votes.shape[0]):
                for k in range(starts[ring], starts[ring + 1]):
                    _vote(votes, ring, y + pad - offsets[k, 0], x + pad - offsets[k, 1])


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
    votes: i32_3,
):
    for ring, y, x in votes:
        votes[ring, y, x] = 0
    pad = (votes.shape[2] - orientation.shape[1]) // 2
    for i in range(starts[starts.shape[0] - 1]):
        y = points[i, 0] + pad
        x = points[i, 1] + pad
        code = direction_code(orientation[points[i, 0], points[i, 1]], zero)
        for ring in range(votes.shape[0]):
            if tolerance < 0:
                down = (radii[ring] * directions[code, 0] + 32768) >> 16
                along = (radii[ring] * directions[code, 1] + 32768) >> 16
                _vote(votes, ring, y + down, x + along)
                _vote(votes, ring, y - down, x - along)
            else:
                for k in range(offset_starts[ring], offset_starts[ring + 1]):
                    for side in range(2):
                        apart = codes[k] - code + side * (DIRECTIONS // 2) + tolerance
                        if (apart & (DIRECTIONS - 1)) <= 2 * tolerance:
                            _vote(votes, ring, y + offsets[k, 0], x + offsets[k, 1])


@ti.kernel
def _share(
    votes: i32_3,
    starts: i32_1,
    zero: ti.i32,
    # outputs
    shares: f32_3,
):
    for ring, y, x in votes:
        size = ti.cast(starts[ring + 1] - starts[ring], ti.f32)
        shares[ring, y, x] = quotient(ti.cast(votes[ring, y, x], ti.f32), size, zero)


def _counts(votes: np.ndarray) -> np.ndarray:
    """Return the array for counts: the result itself, unless the result holds shares."""
    return scratch(votes.shape, np.int32) if votes.dtype == np.float32 else votes


@primitive
def vote_rings(mask: np.ndarray, rings: Rings, reach: int, votes: np.ndarray) -> None:
    """Cast a vote for each offset of each ring from each set pixel; one thread per pixel."""
    counts = _counts(votes)
    _vote_rings(mask, rings.offsets, rings.starts, counts)
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
    counts = _counts(votes)
    radii, offsets, codes, offset_starts = rings
    _vote_directed(
        points, starts, orientation, radii, directions, tolerance, offsets, codes, offset_starts,
        0, counts,
    )  # fmt: skip
    if counts is not votes:
        _share(counts, rings.starts, 0, votes)
