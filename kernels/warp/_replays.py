"""Sequences of launches that CUDA repeats with the same arrays: graphs, kept for a thread.

While a thread records a graph, CUDA refuses calls of other threads that wait for the device. So a
thread announces itself before its first call, and waits there while another one records; and while
other threads use CUDA, nothing is recorded.

A plan repeats the launches of a call with other inputs and results. Between a user's call and its
launches lie checks, choices and views of memory, which take longer than a small kernel runs. A plan
leaves them out: it has the packed launches, and puts the addresses of other arrays into them.
"""

from __future__ import annotations

import threading
import weakref
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import warp as wp

from . import _internals, _scratch
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
    """Make the call, and repeat its launches as one graph from the second time on.

    All that `call` does must follow from its name and from the addresses and shapes of the arrays.
    """
    spoil()
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


Noted = tuple[wp.Kernel, Any, tuple[Any, ...], wp.Device, int, wp.Stream | None]
Notes = list[Noted | None]  # None is work that no plan repeats


class _Noting(threading.local):
    notes: Notes | None = None


_noting = _Noting()


@contextmanager
def noting() -> Iterator[Notes]:
    """Note the launches of this thread in the block."""
    _noting.notes = notes = []
    try:
        yield notes
    finally:
        _noting.notes = None


def note(
    kernel: wp.Kernel,
    dim: Any,
    arguments: Sequence[Any],
    device: wp.Device,
    block: int,
    stream: wp.Stream | None,
) -> None:
    """Note a launch, if this thread notes."""
    if _noting.notes is not None:
        _noting.notes.append((kernel, dim, tuple(arguments), device, block, stream))


def spoil() -> None:
    """Note work that is no launch, so that no plan is made of the notes."""
    if _noting.notes is not None:
        _noting.notes.append(None)


class Plan:
    """Packed launches. They keep the scratch memory and the constants that they address alive."""

    def __init__(self, notes: list[Noted], spans: Sequence[tuple[int, int]]):
        """Pack launches; `spans` are addresses and sizes, in bytes, of the arrays that change."""
        self._age = _scratch.age()
        self._launches: list[tuple[Callable[..., None], wp.Stream | None]] = []
        # Descriptors of arrays that change, the number of their span, and their place in it.
        self._places: list[tuple[Any, int, int]] = []
        self._kept: list[Any] = []
        for kernel, dim, arguments, device, block, stream in notes:
            packed = _internals.PackedLaunch(kernel, dim, arguments, device, block)
            for i, argument in enumerate(arguments):
                found = _span_of(argument, spans)
                if found is None:
                    self._kept.append(argument)
                else:
                    self._places.append((packed.descriptor(i, argument), *found))
            self._launches.append((packed.launch, stream))

    def valid(self) -> bool:
        """Tell whether memory has not been released since."""
        return self._age == _scratch.age()

    def launch(self, addresses: Sequence[int]) -> None:
        """Launch with the arrays at these addresses."""
        for descriptor, n, offset in self._places:
            descriptor.data = addresses[n] + offset
        for launch, stream in self._launches:
            launch(stream)


def plan_of(notes: Notes, spans: Sequence[tuple[int, int]]) -> Plan | None:
    """Return the plan of noted launches; None if it would not do all that was done.

    No launch reads the first span, the image, if the host converted it before.
    """
    launches = [noted for noted in notes if noted is not None]
    if not any(_span_of(a, spans[:1]) for noted in launches for a in noted[2]):
        return None
    inner = (getattr(a, n) for noted in launches for a in noted[2] for n in _arrays_in(a))
    hidden = any(_span_of(a, spans) is not None for a in inner)
    if not _internals.QUICK or not notes or len(launches) < len(notes) or hidden:
        return None
    return Plan(launches, spans)


def _span_of(argument: Any, spans: Sequence[tuple[int, int]]) -> tuple[int, int] | None:
    """Return the number of the span that an array lies in, and its place there."""
    if isinstance(argument, wp.array):
        for n, (address, size) in enumerate(spans):
            offset = (argument.ptr or 0) - address
            if 0 <= offset < size:
                return n, offset
    return None


def _arrays_in(argument: Any) -> list[str]:
    """Return the names of the fields of a structure."""
    return list(argument._cls.vars) if hasattr(argument, "_cls") else []
