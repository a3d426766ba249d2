"""Pages of the host's memory: pinned ones for results of a GPU, and huge ones for scratch memory.

A GPU writes to pinned pages directly, but they take long to allocate. So the pages of a result that
is no longer used are kept for later results, up to a limit. Linux gives huge pages to those who
ask. With them the processor finds the pixels of a column, which lie far apart, without looking up a
page for each.
"""

import contextlib
import ctypes
import math
import sys
import weakref
from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp

_LEAST = 1 << 20  # smallest result in bytes; for smaller ones the copy takes little of the time
_MOST = 1 << 28  # bytes of all pinned pages; further results get ordinary memory
_PAGE = 4096
_LARGE = 1 << 22  # bytes: two huge pages, of which one is whole wherever the memory begins
_MADV_HUGEPAGE = 14
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
    for room, free in _free.copy().items():
        with contextlib.suppress(IndexError):
            while True:
                free.pop()
                _locked -= room


def ask_for_huge_pages(address: int, size: int) -> None:
    """Ask for huge pages behind `size` bytes at `address`; it is no error where there are none."""
    if size < _LARGE:
        return
    advise = _madvise()
    if advise is not None:
        begin = -(-address // _PAGE) * _PAGE
        advise(begin, (address + size) // _PAGE * _PAGE - begin, _MADV_HUGEPAGE)


@lru_cache(maxsize=1)
def _madvise() -> Any:
    """Return the C library's function on Linux."""
    if not sys.platform.startswith("linux"):
        return None
    try:
        function = ctypes.CDLL(None).madvise
    except (OSError, AttributeError):
        return None
    function.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int)
    return function
