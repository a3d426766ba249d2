"""Peaks among the votes for circles on CUDA: a block of threads a row, a thread some votes."""

import warp as wp

from cvkern.kernels.warp._launch import BLOCK
from cvkern.kernels.warp._ranks_cuda import rank_in_block

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

THREADS = wp.constant(BLOCK)


@wp.func
def _is_peak(
    votes: wp.array3d[float], p: int, y: int, x: int, limit: float, down: int, along: int
) -> bool:
    """Tell whether a vote is above its limit, and not below one in the window around it.

    Nor may an equal one precede it.
    """
    here = votes[p, y, x]
    found = here > limit
    if found:
        left = wp.max(x - along, 0)
        right = wp.min(x + along + 1, votes.shape[2])
        bottom = wp.min(y + down + 1, votes.shape[1])
        row = wp.max(y - down, 0)
        while found and row < bottom:
            column = left
            while found and column < right:
                other = votes[p, row, column]
                before = row < y or (row == y and column < x)
                found = not (other > here or (other == here and before))
                column += 1
            row += 1
    return found


@wp.func
def _peaks_of(
    votes: wp.array3d[float], p: int, y: int, span: wp.vec2i, limit: float, down: int, along: int
) -> int:
    count = int(0)
    for x in range(span[0], span[1]):
        if _is_peak(votes, p, y, x, limit, down, along):
            count += 1
    return count


@wp.func
def _span(width: int, thread: int) -> wp.vec2i:
    """Return the first vote of a thread, and the one behind the last."""
    each = (width + THREADS - 1) // THREADS
    return wp.vec2i(wp.min(thread * each, width), wp.min((thread + 1) * each, width))


@wp.kernel
def count_peaks(
    votes: wp.array3d[float],  # (P, H, W)
    limits: wp.array[float],  # (P,)
    down: int,
    along: int,
    # outputs
    counts: wp.array[int],  # (P H,)
):
    row = wp.tid() // THREADS
    thread = wp.tid() - row * THREADS
    p = row // votes.shape[1]
    span = _span(votes.shape[2], thread)
    count = _peaks_of(votes, p, row - p * votes.shape[1], span, limits[p], down, along)
    before = rank_in_block(count)
    if thread == THREADS - 1:
        counts[row] = before + count


@wp.kernel
def gather_peaks(
    votes: wp.array3d[float],  # (P, H, W)
    limits: wp.array[float],  # (P,)
    down: int,
    along: int,
    starts: wp.array[int],  # (P H + 1,)
    # outputs
    places: wp.array2d[int],  # (N, 3)
    values: wp.array[float],  # (N,)
):
    row = wp.tid() // THREADS
    p = row // votes.shape[1]
    y = row - p * votes.shape[1]
    span = _span(votes.shape[2], wp.tid() - row * THREADS)
    n = starts[row] + rank_in_block(_peaks_of(votes, p, y, span, limits[p], down, along))
    for x in range(span[0], span[1]):
        if _is_peak(votes, p, y, x, limits[p], down, along):
            places[n, 0] = p
            places[n, 1] = y
            places[n, 2] = x
            values[n] = votes[p, y, x]
            n += 1
