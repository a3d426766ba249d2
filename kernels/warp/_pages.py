"""Host memory that a GPU writes to directly: pages locked in place, which take long to get.

So results leave theirs to later ones when they are gone. There is room for a few.
"""

import contextlib
import ctypes
import math
import weakref

import numpy as np
import warp as wp

_LEAST = 1 << 20  # bytes of a result: of less, the copy is not what takes long
_MOST = 1 << 28  # bytes of all; results beyond have memory as any
_locked = 0
_free: dict[int, list[wp.array]] = {}


def empty(shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    """Return uninitialised memory for a result, locked if there is any."""
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
    # All views of an array end at what it was made from: that goes last.
    weakref.finalize(memory, free.append, block).atexit = False
    return np.frombuffer(memory, dtype).reshape(shape)


def release() -> None:
    """Unlock the pages that no result holds."""
    global _locked
    for room, free in list(_free.items()):
        with contextlib.suppress(IndexError):
            while True:
                free.pop()
                _locked -= room
