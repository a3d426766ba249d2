"""The memory that primitives work in, kept for each thread and stream from call to call."""

from __future__ import annotations

import contextlib
import math
import os
import threading
import weakref
from collections.abc import Iterator
from typing import Any

import warp as wp

from ._huge_pages import ask_for_huge_pages
from ._internals import view_at
from ._streams import current_stream

PAGE = 4096  # bytes below which the overhead of a copy to the host dominates its time
MOST_MB = 1024  # MiB on the host that all threads keep together, unless CVKERN_SCRATCH_MB says
_MAX_VIEWS = 16  # views that an array keeps

_Key = tuple[str, str, int]  # name, device and stream


class _Block:
    """Memory, and the views of it that were asked for; a view keeps the memory, not the block."""

    def __init__(self, size: int, device: wp.Device):
        # In words: Warp counts the elements of an axis with 31 bits.
        self.memory = wp.empty(-(-size // 8), dtype=wp.uint64, device=device)
        if not device.is_cuda:
            ask_for_huge_pages(self.memory.ptr or 0, size)
        self.views: dict[Any, wp.array] = {}
        self.age = _age
        self.bytes_on_host = 0 if device.is_cuda else self.memory.capacity

    def view(self, dtype: Any, shape: tuple[int, ...]) -> wp.array:
        seen = self.views.get((dtype, shape))
        if seen is None:
            if len(self.views) >= _MAX_VIEWS:
                self.views.clear()
            seen = view_at(self.memory.ptr, dtype, shape, self.memory.device)
            seen.owner = self.memory  # pyright: ignore[reportAttributeAccessIssue]
            self.views[dtype, shape] = seen
        return seen


class _ThreadsBlocks(dict[_Key, _Block]):
    """The blocks of a thread, which goes with them."""


class _ThreadState(threading.local):
    page: wp.array | None = None

    def __init__(self) -> None:
        self.blocks = _ThreadsBlocks()
        self.scratch: dict[_Key, _Block] = self.blocks
        with _lock:
            _threads[id(self.blocks)] = self.blocks


_age = 0  # how often memory was released
_lock = threading.Lock()
_threads: weakref.WeakValueDictionary[int, _ThreadsBlocks] = weakref.WeakValueDictionary()
_thread = _ThreadState()


def _after_fork() -> None:
    """Forget the parent's lock: a forked child has none of the threads that may hold it."""
    global _lock
    _lock = threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def scratch(name: str, shape: tuple[int, ...], dtype: Any, device: wp.Device) -> wp.array:
    """Return uninitialised memory that stays valid until this thread asks for `name` again."""
    blocks = _thread.scratch
    shared = blocks is _thread.blocks
    stream = current_stream(device).cuda_stream or 0 if device.is_cuda and shared else 0
    key = (name, device.alias, stream)
    size = math.prod(shape) * wp.types.type_size_in_bytes(dtype)
    block = blocks.get(key)
    if block is None or block.memory.capacity < size or (block.age != _age and shared):
        if block is not None and device.is_cuda:  # kernels may still be at work in the old one
            wp.synchronize_stream(current_stream(device))
        blocks.pop(key, None)
        block = _Block(size, device)
        if device.is_cuda:  # the allocation is ordered on another stream than its users
            wp.synchronize_stream(device.stream)
        if not shared or _make_room(blocks, block.bytes_on_host):
            blocks[key] = block
    return block.view(dtype, shape)


def _make_room(own: dict[_Key, _Block], size: int) -> bool:
    """Give up what earlier calls left on the host until `size` bytes more may stay, if they may.

    The oldest go first, those of this thread before others. A call that still works in one has
    a view of it, which keeps it.
    """
    most = _most()
    if size > most:
        return False
    with _lock:
        others = [blocks for blocks in _threads.values() if blocks is not own]
    kept = [(blocks, *item) for blocks in (own, *others) for item in list(blocks.items())]
    total = size + sum(block.bytes_on_host for _, _, block in kept)
    for blocks, key, block in kept:
        if total <= most:
            break
        if block.bytes_on_host:
            blocks.pop(key, None)
            total -= block.bytes_on_host
    return True


def _most() -> int:
    asked = os.environ.get("CVKERN_SCRATCH_MB") or str(MOST_MB)
    if not asked.isdecimal():
        raise ValueError(f"CVKERN_SCRATCH_MB must be an integer >= 0, got {asked!r}")
    return int(asked) << 20


def release() -> None:
    """Give up what threads keep: on the host of all, on GPUs of this one and, later, of others."""
    global _age
    own = _thread.blocks
    for alias in {key[1] for key, block in own.items() if not block.bytes_on_host}:
        wp.synchronize_device(alias)
    own.clear()
    _thread.page = None
    with _lock:
        _age += 1
        others = [blocks for blocks in _threads.values() if blocks is not own]
    for blocks in others:
        for key, block in list(blocks.items()):
            if block.bytes_on_host:
                blocks.pop(key, None)


@contextlib.contextmanager
def own_scratch(scratch: dict[_Key, _Block]) -> Iterator[None]:
    """Use `scratch` for the block: a CUDA graph keeps the addresses it was recorded with."""
    shared, _thread.scratch = _thread.scratch, scratch
    try:
        yield
    finally:
        _thread.scratch = shared


def known_scratch(device: wp.Device) -> dict[_Key, _Block]:
    """Return what :func:`scratch` has given this thread on its stream, for :func:`own_scratch`."""
    shared = _thread.scratch is _thread.blocks
    stream = current_stream(device).cuda_stream or 0 if shared else 0
    return {
        (name, where, 0): block
        for (name, where, of), block in _thread.scratch.items()
        if (where, of) == (device.alias, stream)
    }


def page(dtype: Any, shape: tuple[int, ...]) -> wp.array:
    """Return host memory that a GPU writes to directly, of this thread, of at most `PAGE` bytes."""
    if _thread.page is None:
        _thread.page = wp.empty(PAGE, dtype=wp.uint8, device="cpu", pinned=True)
    return view(_thread.page, dtype, shape)


def view(
    array: wp.array, dtype: Any, shape: tuple[int, ...], strides: tuple[int, ...] | None = None
) -> wp.array:
    """See the memory of `array` otherwise; the view is kept with it."""
    views = array.__dict__.setdefault("views", {})
    key = (dtype, shape)
    seen = views.get(key)
    if seen is None:
        if len(views) >= _MAX_VIEWS:
            views.clear()
        seen = views[key] = view_at(array.ptr, dtype, shape, array.device, strides)
        # What `array` itself keeps alive; `array` would be a circle.
        seen.owner = array.__dict__.get("owner")  # pyright: ignore[reportAttributeAccessIssue]
    return seen
