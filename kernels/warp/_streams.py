"""The CUDA stream that the launches of a Python thread go to, and memory that is lent to it.

Warp allocates in the order of its own stream, and frees in the order of CUDA's default stream.
Neither waits for such a stream as PyTorch makes. So memory that is used there is complete before it
is lent, and is freed only when the kernels that were launched before its end have run.
"""

from __future__ import annotations

import contextlib
import threading
import weakref
from collections import deque
from collections.abc import Iterator
from typing import Any

import warp as wp


class _Caller(threading.local):
    stream: wp.Stream | None = None
    fixed: bool = False  # whether the stream stays, whatever stream the callers' arrays use


_caller = _Caller()


def set_stream(stream: wp.Stream | None) -> None:
    """Direct this thread's CUDA launches to `stream`."""
    if not _caller.fixed:
        _caller.stream = stream


@contextlib.contextmanager
def only_stream(stream: wp.Stream) -> Iterator[None]:
    """Direct the launches of the block to `stream`; :func:`set_stream` has no effect in it."""
    before = _caller.stream
    _caller.stream, _caller.fixed = stream, True
    try:
        yield
    finally:
        _caller.stream, _caller.fixed = before, False


def current_stream(device: wp.Device) -> wp.Stream:
    """Return the stream that this thread's launches on `device` go to."""
    stream = _caller.stream
    return stream if stream is not None and stream.device == device else device.stream


class _Loan:
    """What owns lent memory: when no view has it any more, the memory is given back."""


_lock = threading.Lock()
_returned: deque[tuple[wp.Event, wp.array]] = deque()
_recorded: list[wp.array] = []  # a recording that uses these could be repeated at any time


def lend(array: wp.array) -> Any:
    """Return the owner that all views of new memory have to keep."""
    device = array.device
    wp.synchronize_stream(device.stream)  # the kernels may run on another stream
    _free()
    if current_stream(device).cuda_stream == device.stream.cuda_stream:
        return array
    loan = _Loan()
    weakref.finalize(loan, _give_back, array).atexit = False
    return loan


def _give_back(array: wp.array) -> None:
    """Return a loan: note the event after which the work of this thread no longer needs it."""
    stream = current_stream(array.device)
    if stream.is_capturing:
        _recorded.append(array)
    else:
        _returned.append((stream.record_event(), array))


def _free() -> None:
    """Free memory, oldest first, until kernels are found that may still use theirs."""
    with _lock:
        while _returned and _returned[0][0].is_complete:
            _returned.popleft()
