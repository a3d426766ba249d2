"""Host memory that a GPU writes to directly: pages locked in place, which take long to get.

So a few results of a size have such memory, and leave it to later ones when they are gone.
"""

import ctypes
import math
import weakref

import numpy as np
import warp as wp

_LEAST = 1 << 20  # bytes: of less, the copy is not what takes long
_MOST = 4  # results of a size at once; more have memory as any
_free: dict[int, list[wp.array]] = {}
_made: dict[int, int] = {}


def empty(shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    """Return uninitialised memory for a result, locked if there is any."""
    size = math.prod(shape) * dtype.itemsize
    if size < _LEAST:
        return np.empty(shape, dtype)
    free = _free.setdefault(size, [])
    try:
        block = free.pop()
    except IndexError:
        if _made.get(size, 0) >= _MOST:
            return np.empty(shape, dtype)
        _made[size] = _made.get(size, 0) + 1
        block = wp.empty(size, dtype=wp.uint8, device="cpu", pinned=True)
    memory = (ctypes.c_uint8 * size).from_address(block.ptr)
    # All views of an array end at what it was made from: that goes last.
    weakref.finalize(memory, free.append, block).atexit = False
    return np.frombuffer(memory, dtype).reshape(shape)
