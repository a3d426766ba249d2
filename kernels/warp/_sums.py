"""Prefix sums, in order with the kernels."""

import warp as wp

from ._launch import current_stream
from ._replays import spoil


def scan(counts: wp.array) -> None:
    """Replace each count by the sum up to it, on a GPU on the stream of this thread's kernels."""
    spoil()
    if counts.device.is_cuda:
        with wp.ScopedStream(current_stream(counts.device), sync_enter=False):
            wp.utils.array_scan(counts, counts, inclusive=True)
    else:
        wp.utils.array_scan(counts, counts, inclusive=True)
