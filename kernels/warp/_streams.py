"""The CUDA stream that the launches of a Python thread go to."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator

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
