"""Host memory that a GPU writes to directly: pinned pages, which take long to allocate.

So the pages of a result that is no longer used are kept for later results, up to a limit.
"""

import contextlib
import ctypes
import math
import weakref

import numpy as np
import warp as wp

_LEAST = 1 << 20  # smallest result in bytes; for smaller ones the copy takes little of the time
_MOST = 1 << 28  # bytes of all pinned pages; further results get ordinary memory
_locked = 0
_free: dict[int, list[wp.array]] = {}


def empty(shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    """Return uninitialised memory for a result, pinned if there is room."""
    global _locked
    size = math.prod(shape) * dtype.itemsize
    if size < _LEAST:
        return np.empty(shape, dtype)
    room = 1 << (size - 1).bit_length()
    free = _free.setdefault(room, [])
    try:
        block = free.pop()
    except IndexError:
        if _locked + room > _MOST:
            return np.empty(shape, dtype)
        _locked += room
        block = wp.empty(room, dtype=wp.uint8, device="cpu", pinned=True)
    memory = (ctypes.c_uint8 * size).from_address(block.ptr)
    # All views of an array keep the base object alive, so it is released last.
    weakref.finalize(memory, free.append, block).atexit = False
    return np.frombuffer(memory, dtype).reshape(shape)


def release() -> None:
    """Free the pinned pages that no result uses."""
    global _locked
    for room, free in list(_free.items()):
        with contextlib.suppress(IndexError):
            while True:
                free.pop()
                _locked -= room
