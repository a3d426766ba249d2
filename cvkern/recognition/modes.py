"""Modes of the density of votes."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern._runtime import Runtime
from cvkern.kernels.codes.recognition import Occurrences, Patches
from cvkern.recognition.votes import Hall

MOST_MODES = 512  # maxima that are followed up, the highest


def find_modes(
    rt: Runtime, patches: Patches, occurrences: Occurrences, place: Hall, sums: Any, room: int
) -> tuple[Any, Any]:
    """Return the modes of the votes of patches (M, 4), those that are none with density 0.

    Also return where the votes of each cell begin: if the last one is beyond the `room` for votes
    on a GPU, some were left out. `sums` become the sums of weights.
    """
    cast, kernels, space = rt.recognition.votes, rt.recognition.modes, place.space
    cells = sums.shape[0]
    counts = rt.scratch("recognition.counts", (cells,), np.int32)
    starts = rt.scratch("recognition.starts", (cells + 1,), np.int32)
    cast.count_votes(patches, occurrences, space, sums, counts)
    maxima = rt.scratch("recognition.maxima", (place.tiles.shape[0], 4), np.int32)
    kernels.find_maxima(sums, space, place.tiles, maxima)
    highest, modes, single = (
        rt.scratch(f"recognition.{name}", (MOST_MODES, 4), np.int32)
        for name in ("highest", "modes", "single")
    )
    kernels.select_maxima(maxima, highest)
    cast.mark_votes(highest, space, place.window, counts, starts)
    if rt.device == "cpu":
        room = int(rt.host_view(starts)[-1])
    votes = rt.scratch("recognition.votes", (room, 4), np.int32)
    cast.list_votes(patches, occurrences, space, starts, votes)
    kernels.shift_modes(votes, starts, space, place.window, highest, modes)
    kernels.single_modes(modes, place.spans, space.lowest, single)
    return single, starts


def distinct(modes: np.ndarray) -> np.ndarray:
    """Return the first index of each place and scale, in the order of rows, columns and scales."""
    row, column, scale = (modes[:, k].astype(np.int64) for k in range(3))
    key = ((row << 26) + column << 12) + scale  # |column| < 2^25 and |scale| < 2^11
    return np.unique(key, return_index=True)[1]
