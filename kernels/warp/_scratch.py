"""Scratch memory of primitives, kept from call to call for each thread and stream."""

from __future__ import annotations

import contextlib
import math
import os
import threading
import weakref
from collections.abc import Iterator
from typing import Any

import warp as wp

from ._internals import view_at
from ._pages import ask_for_huge_pages
from ._streams import current_stream

PAGE = 4096  # bytes below which the overhead of a copy to the host dominates its time
MOST_MB = 1024  # MiB that all threads together keep on the host; CVKERN_SCRATCH_MB overrides it
_SMALL = 1 << 20  # bytes up to which a block on the host has a power of two
_MAX_VIEWS = 16  # largest number of views that an array keeps

_Key = tuple[str, str, int]  # name, device and stream


class _Block:
    """Memory with its views; a view keeps the memory alive, but not the block."""

    def __init__(self, size: int, device: wp.Device):
        if size <= _SMALL and not device.is_cuda:
            # Plans keep blocks alive: those of somewhat larger images then share one.
            size = 1 << max(size - 1, 7).bit_length()
        # Allocate words, because Warp counts the elements of an axis with 31 bits.
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
    """The blocks of a thread; they are freed with the thread."""


class _ThreadState(threading.local):
    page: wp.array | None = None

    def __init__(self) -> None:
        self.blocks = _ThreadsBlocks()
        self.scratch: dict[_Key, _Block] = self.blocks
        with _lock:
            _threads[id(self.blocks)] = self.blocks


_age = 0  # number of times that memory was released
_lock = threading.Lock()
_threads: weakref.WeakValueDictionary[int, _ThreadsBlocks] = weakref.WeakValueDictionary()
_thread = _ThreadState()


def _after_fork() -> None:
    """Replace the parent's lock, because a forked child has no thread that could release it."""
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
        if block is not None and device.is_cuda:  # kernels may still use the old block
            wp.synchronize_stream(current_stream(device))
        blocks.pop(key, None)
        block = _Block(size, device)
        if device.is_cuda:  # the allocation is ordered on another stream than its users
            wp.synchronize_stream(device.stream)
        if not shared or _make_room(blocks, block.bytes_on_host):
            blocks[key] = block
    return block.view(dtype, shape)


def _make_room(own: dict[_Key, _Block], size: int) -> bool:
    """Free host blocks of earlier calls until `size` more bytes fit; tell whether they fit.

    The oldest blocks go first, those of this thread before others. A running call has a view of its
    block, which keeps the memory alive.
    """
    most = _most()
    if size > most:
        return False
    with _lock:
        others = [blocks for blocks in _threads.values() if blocks is not own]
    # A copy is made in one step; while a list is made of the items, another thread may change them.
    kept = [(blocks, *item) for blocks in (own, *others) for item in blocks.copy().items()]
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


def age() -> int:
    """Return the number of times that memory was released."""
    return _age


def release() -> None:
    """Free all blocks on the host and this thread's on GPUs; other threads free theirs later."""
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
        for key, block in blocks.copy().items():
            if block.bytes_on_host:
                blocks.pop(key, None)


@contextlib.contextmanager
def own_scratch(scratch: dict[_Key, _Block]) -> Iterator[None]:
    """Use `scratch` in the block, because a CUDA graph keeps the addresses of its recording."""
    shared, _thread.scratch = _thread.scratch, scratch
    try:
        yield
    finally:
        _thread.scratch = shared


def known_scratch(device: wp.Device) -> dict[_Key, _Block]:
    """Return the blocks of this thread on its stream, for :func:`own_scratch`."""
    shared = _thread.scratch is _thread.blocks
    stream = current_stream(device).cuda_stream or 0 if shared else 0
    return {
        (name, where, 0): block
        for (name, where, of), block in _thread.scratch.items()
        if (where, of) == (device.alias, stream)
    }


def page(dtype: Any, shape: tuple[int, ...]) -> wp.array:
    """Return pinned host memory of this thread, of at most `PAGE` bytes."""
    if _thread.page is None:
        _thread.page = wp.empty(PAGE, dtype=wp.uint8, device="cpu", pinned=True)
    return view(_thread.page, dtype, shape)


def view(
    array: wp.array, dtype: Any, shape: tuple[int, ...], strides: tuple[int, ...] | None = None
) -> wp.array:
    """View the memory of `array` with another dtype or shape, and keep that memory alive.

    The view is kept with the array for later calls, unless the array itself owns the memory: each
    would keep the other alive.
    """
    owner = array.__dict__.get("owner")
    if owner is None:
        seen = view_at(array.ptr, dtype, shape, array.device, strides)
        seen.owner = array  # pyright: ignore[reportAttributeAccessIssue]
        return seen
    views = array.__dict__.setdefault("views", {})
    key = (dtype, shape)
    seen = views.get(key)
    if seen is None:
        if len(views) >= _MAX_VIEWS:
            views.clear()
        seen = views[key] = view_at(array.ptr, dtype, shape, array.device, strides)
        seen.owner = owner  # pyright: ignore[reportAttributeAccessIssue]
    return seen
