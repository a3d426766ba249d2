"""Memory of results that is used again, and memory that the process holds beyond what it uses.

A large block that is freed goes back to the system, and the next one of its size costs a page fault
for every 4 KiB, which takes longer than a filter. So the memory of results on the host that are no
longer used is kept for later results, up to a limit.
"""

from __future__ import annotations

import ctypes
import math
import weakref
from contextlib import suppress

import numpy as np

_LEAST = 1 << 20  # smallest result in bytes; page faults of smaller ones take little time
_MOST = 1 << 28  # bytes that are kept of results which nobody uses
_STEP = 1 << 16  # sizes in bytes are rounded up to a multiple
_free: dict[int, list[np.ndarray]] = {}  # by size; the one used last is the last


def empty(shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    """Return uninitialised memory for a result."""
    size = math.prod(shape) * dtype.itemsize
    if not _LEAST <= size <= _MOST:
        return np.empty(shape, dtype)
    room = -(-size // _STEP) * _STEP
    free = _free.pop(room, [])
    _free[room] = free
    try:
        block = free.pop()
    except IndexError:
        block = np.empty(room, np.uint8)
    memory = (ctypes.c_uint8 * size).from_address(block.ctypes.data)
    # All views of an array keep the base object alive, so it is released last.
    weakref.finalize(memory, _keep, block).atexit = False
    return np.frombuffer(memoryview(memory), dtype).reshape(shape)


def _keep(block: np.ndarray) -> None:
    """Keep a block, and free others of sizes that were not used for longest."""
    _free.setdefault(block.size, []).append(block)
    for room, free in _free.copy().items():
        while free and sum(n * len(blocks) for n, blocks in _free.copy().items()) > _MOST:
            with suppress(IndexError):  # another thread took the last one
                free.pop()
        if not free:
            _free.pop(room, None)


def trim() -> None:
    """Free the memory of results that nobody uses, and give freed memory back to the system.

    The C library does the second where it can; glibc keeps memory by itself.
    """
    _free.clear()
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)
