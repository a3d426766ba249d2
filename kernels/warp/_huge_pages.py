"""Huge pages for the scratch memory of the host, where Linux gives them to those who ask.

A column of a large image has each pixel on a page of its own, of which the processor knows few.
"""

import ctypes
import sys
from functools import lru_cache
from typing import Any

PAGE = 4096
LEAST = 1 << 22  # bytes: two huge pages, of which one is whole wherever the memory begins
_MADV_HUGEPAGE = 14


def ask_for_huge_pages(address: int, size: int) -> None:
    """Ask for huge pages behind `size` bytes at `address`; it is no error where there are none."""
    if size < LEAST:
        return
    advise = _madvise()
    if advise is not None:
        begin = -(-address // PAGE) * PAGE
        advise(begin, (address + size) // PAGE * PAGE - begin, _MADV_HUGEPAGE)


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
