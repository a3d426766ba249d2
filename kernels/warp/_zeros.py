"""Filling memory with 0, in order with the kernels."""

import warp as wp

from ._launch import current_stream
from ._replays import spoil


def clear(array: wp.array) -> None:
    """Fill `array` with 0, on a GPU on the stream that this thread's kernels go to."""
    spoil()
    if array.device.is_cuda:
        with wp.ScopedStream(current_stream(array.device), sync_enter=False):
            array.zero_()
    else:
        array.zero_()
