"""Which Python threads use CUDA: graphs are recorded only while no other one does.

While a thread records, CUDA refuses calls of other threads that wait for the device. So a thread
announces itself before its first call, and waits there while another one records.
"""

from __future__ import annotations

import threading
import weakref
from collections.abc import Iterator
from contextlib import contextmanager


class _Thread(threading.local):
    known: bool = False


_thread = _Thread()
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
