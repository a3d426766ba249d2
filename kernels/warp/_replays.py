"""Sequences of launches that CUDA repeats with the same arrays: graphs, kept for a thread.

While a thread records a graph, CUDA refuses calls of other threads that wait for the device. So a
thread announces itself before its first call, and waits there while another one records; and while
other threads use CUDA, nothing is recorded.
"""

from __future__ import annotations

import threading
import weakref
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager

import warp as wp

from . import _scratch
from ._streams import current_stream

_MOST = 3  # sequences that a thread keeps; each keeps the memory alive that it addresses


class _Thread(threading.local):
    """The graphs of a thread, None before the second time, and the age of their memory."""

    known: bool = False  # whether the thread has announced itself

    def __init__(self) -> None:
        self.kept: dict[Hashable, Callable[[], None] | None] = {}
        self.age = -1


_thread = _Thread()


def repeat(name: Hashable, call: Callable[[], None], arrays: Sequence[wp.array]) -> None:
    """Launch what `call` launches, from the second time on as one graph.

    All that `call` does must follow from its name and from the addresses and shapes of the arrays.
    """
    device = arrays[0].device
    stream = current_stream(device)
    if stream.is_capturing:
        call()
        return
    if _thread.age != _scratch.age():
        release()
    kept = _thread.kept
    key = (name, device.alias, stream.cuda_stream, *((a.ptr, a.shape) for a in arrays))
    if key not in kept:
        call()  # loads modules, and allocates scratch memory
        while len(kept) >= _MOST:
            kept.pop(next(iter(kept)))
        kept[key] = None
        return
    graph = kept.pop(key)
    if graph is None:
        from . import record

        graph = record(call, device.alias)
    kept[key] = None if graph is call else graph  # the last one used is the last one forgotten
    graph()


def release() -> None:
    """Forget the graphs of this thread."""
    _thread.kept.clear()
    _thread.age = _scratch.age()


_threads: weakref.WeakSet[threading.Thread] = weakref.WeakSet()
_lock = threading.RLock()


def announce() -> None:
    """Note that this thread uses CUDA."""
    if not _thread.known:
        with _lock:
            _threads.add(threading.current_thread())
        _thread.known = True


@contextmanager
def alone() -> Iterator[bool]:
    """Yield whether this thread alone uses CUDA; others cannot begin in the block."""
    with _lock:
        this = threading.current_thread()
        yield not any(thread.is_alive() for thread in _threads if thread is not this)
