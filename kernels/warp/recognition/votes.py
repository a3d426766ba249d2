"""Votes of words for centres of objects, in Warp.

A patch with m words casts the weights of each word's occurrences, divided by m and rounded down.
Every sum is of integers, so that no order shows. On the CPU a thread has the votes for some rows of
cells; on CUDA a few threads have one word of one patch.
"""

import numpy as np
import warp as wp

from cvkern.kernels.codes import recognition as codes
from cvkern.kernels.codes.recognition import Occurrences, Patches, Space, Window
from cvkern.kernels.warp._launch import launch, launch_each, launch_slabs, scratch, slabs
from cvkern.kernels.warp._sums import scan
from cvkern.kernels.warp._zeros import clear

from . import _votes_cpu as cpu
from . import _votes_cuda as cuda
from ._space import Ballot, ballot_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

VOTES_OF_WORD = 32  # votes of a word, roughly: for the number of threads only
AROUND = wp.constant(codes.AROUND)
MARKED = (2 * codes.AROUND + 1) ** 2
BANDS = 4  # bands of cells of a thread on the CPU


def count_votes(
    patches: Patches, occurrences: Occurrences, space: Space, sums: wp.array, counts: wp.array
) -> None:
    """Add up the weights of the votes for each of C cells, and count the votes."""
    ballot = ballot_of(patches, occurrences, space, 0, counts)
    if not sums.device.is_cuda:
        _cast(ballot, [sums, counts, None])
        return
    cells = scratch("recognition.room", counts.shape, wp.uint64, counts.device)
    clear(cells)
    launch(cuda.cast, patches.matches.size * cuda.LANES, [ballot], [cells, None])
    launch(cuda.split, counts.size, [cells], [sums, counts])


def mark_votes(
    maxima: wp.array, space: Space, window: Window, counts: wp.array, starts: wp.array
) -> None:
    """List where the votes of each cell begin that is within `AROUND` cells of a maximum.

    Other cells have no room in `starts` (C + 1,), which ends with the number of votes. Every bin is
    marked that the kernel of mean shift reaches.
    """
    clear(starts)
    bins = space.bins.shape[0]
    reach = window.scales + space.slack
    count = maxima.shape[0] * bins
    launch_each(_mark, count, count * MARKED, [maxima, space.bins, reach, counts], [starts])
    scan(starts)


@wp.kernel
def _mark(
    stride: int,
    begin: int,
    end: int,
    maxima: wp.array2d[int],  # (T, 4)
    bins: wp.array2d[int],  # (S, 5)
    reach: int,
    counts: wp.array[int],
    # outputs
    starts: wp.array[int],  # (C + 1,)
):
    for item in range(begin + wp.tid(), end, stride):
        t = item // bins.shape[0]
        s = item - t * bins.shape[0]
        if maxima[t, 3] > 0 and wp.abs(bins[s, 3] - maxima[t, 2]) <= reach:
            row = maxima[t, 0] // bins[s, 4]
            column = maxima[t, 1] // bins[s, 4]
            left = wp.max(column - AROUND, 0)
            right = wp.min(column + AROUND + 1, bins[s, 2])
            for y in range(wp.max(row - AROUND, 0), wp.min(row + AROUND + 1, bins[s, 1])):
                for x in range(left, right):
                    c = bins[s, 0] + y * bins[s, 2] + x
                    starts[c + 1] = counts[c]


def list_votes(
    patches: Patches,
    occurrences: Occurrences,
    space: Space,
    starts: wp.array,
    votes: wp.array,
) -> None:
    """List the votes of each cell with room, in any order: V rows of place, scale and weight.

    Cells whose votes would lie behind the last row are left out.
    """
    ballot = ballot_of(patches, occurrences, space, 1, starts)
    if not starts.device.is_cuda:
        _cast(ballot, [starts, starts, votes])
        return
    cells = scratch("recognition.room", (starts.size - 1,), wp.uint64, starts.device)
    clear(cells)
    launch(cuda.cast, patches.matches.size * cuda.LANES, [ballot], [cells, votes])


def _cast(ballot: Ballot, outputs: list) -> None:
    """Count or list votes on the CPU; a thread takes bands of cells."""
    device, matches, entries = ballot.places.device, ballot.matches, ballot.entries.shape[0]
    bins, levels, words = (a.shape[0] for a in (ballot.bins, ballot.levels, ballot.begins))
    parts = slabs(matches.shape[0], matches.size * VOTES_OF_WORD)
    at_words = scratch("recognition.laid", (levels, bins, 3 * words), wp.int32, device)
    live = scratch("recognition.live", (levels, 4, entries + cpu.LANES), wp.int32, device)
    launch_slabs(cpu.lay, levels, min(parts, levels), [ballot], [at_words, live])
    bands, cells = _bands(ballot.bins.numpy(), BANDS * parts if parts > 1 else 1)
    room = scratch("recognition.room", (cells + len(bands) * cpu.LANES,), wp.uint64, device)
    inputs = [ballot, wp.array(bands, dtype=wp.int32, device=device, copy=False), at_words, live]
    launch_slabs(cpu.cast, len(bands), len(bands), [*inputs, room], outputs)


def _bands(bins: np.ndarray, count: int) -> tuple[np.ndarray, int]:
    """Return about `count` bands of rows of the bins (B, 3), and the number of cells."""
    cells = bins[:, 1] * bins[:, 2]
    found = []
    for s, (rows, own) in enumerate(zip(bins[:, 1], cells, strict=True)):
        number = min(max(1, round(count * own / cells.sum())), rows)
        ends = rows * np.arange(number + 1) // number
        found.append(np.column_stack([np.full(number, s), ends[:-1], ends[1:]]))
    return np.concatenate(found).astype(np.int32), int(cells.sum())
