"""Files that are mapped into memory: read ahead, written past the map, and let go of.

To write a page through a map costs a page fault, which takes as long as two copies of the page. The
system's call to write whole rows takes half the time. Both see the same bytes.
"""

from __future__ import annotations

import contextlib
import ctypes
import mmap
import os
from collections.abc import Sequence
from typing import Any

import numpy as np

_STEP = 4096  # bytes of the smallest page
_BUFFERS = 1024  # pieces of memory that the system writes by one call
_SHARED = "r", "r+", "w+"  # modes of memory maps whose pages belong to the file


def _map_of(array: Any) -> tuple[mmap.mmap, int] | None:
    """Return the map of the file that an array views, and the byte at which the array begins."""
    base: Any = array
    while isinstance(base, np.ndarray):
        if isinstance(base, np.memmap) and base.mode not in _SHARED:
            return None
        base = base.base
    if not isinstance(base, mmap.mmap):
        return None
    return base, array.ctypes.data - np.frombuffer(base, np.uint8).ctypes.data


def touch(window: np.ndarray) -> None:
    """Read the pages of a window of a mapped file, so that a kernel need not wait for them."""
    if _map_of(window) and window.size:
        window[:, :: max(1, _STEP // max(1, abs(window.strides[1])))].max()


def let_go(array: Any, rows: slice) -> None:
    """Let go of the pages of rows of a mapped file; the system keeps the file's contents."""
    found = _map_of(array)
    if not found or not array.flags.c_contiguous or not hasattr(mmap, "MADV_DONTNEED"):
        return
    pages, begin = found
    first, end = (begin + row * array.strides[0] for row in (rows.start, rows.stop))
    first, end = -(-first // mmap.PAGESIZE) * mmap.PAGESIZE, end // mmap.PAGESIZE * mmap.PAGESIZE
    if first < end:
        with contextlib.suppress(OSError):  # pages that a program locked stay
            pages.madvise(mmap.MADV_DONTNEED, first, end - first)


class MappedRows:
    """The file of a memory map, open for writing whole rows."""

    def __init__(self, array: np.memmap, file: int, begin: int) -> None:
        self.array, self.file, self.begin = array, file, begin

    @staticmethod
    def of(array: Any) -> MappedRows | None:
        """Return the rows of a mapped array, if its file can be found and is open to writing."""
        if not isinstance(array, np.memmap) or array.mode == "r" or not array.filename:
            return None
        if _map_of(array) is None or not array.flags.c_contiguous or not hasattr(os, "pwritev"):
            return None
        place = _place_of(array.ctypes.data)
        if place is None:
            return None
        try:
            file = os.open(array.filename, os.O_WRONLY | os.O_CLOEXEC)
        except OSError:
            return None
        status, (begin, *identity) = os.fstat(file), place
        # Another file may have taken the name since it was mapped.
        if identity != [os.major(status.st_dev), os.minor(status.st_dev), status.st_ino]:
            os.close(file)
            return None
        return MappedRows(array, file, begin)

    def write(self, first: int, parts: Sequence[np.ndarray]) -> None:
        """Write parts that lie side by side and fill rows, the first of which has this number."""
        at, pitch = self.begin + first * self.array.strides[0], self.array.strides[0]
        lines = [_lines(part) for part in parts]
        step = max(1, _BUFFERS // len(lines))
        try:
            for top in range(0, len(parts[0]), step):
                some = [line[top : top + step] for line in lines]
                self._write([piece for row in zip(*some, strict=True) for piece in row], at)
                at += pitch * len(some[0])
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self.array.filename)) from None

    def _write(self, pieces: list[memoryview], at: int) -> None:
        while pieces:
            count = os.pwritev(self.file, pieces, at)
            at, done = at + count, 0
            while done < len(pieces) and count >= len(pieces[done]):
                count -= len(pieces[done])
                done += 1
            pieces = pieces[done:]
            if count:
                pieces[0] = pieces[0][count:]

    def close(self) -> None:
        """Close the file."""
        os.close(self.file)


def _lines(part: np.ndarray) -> list[memoryview]:
    """Return the bytes of each row of an array, whose rows have no gaps."""
    size, pitch = part[0].nbytes, part.strides[0]
    if not part[0].flags.c_contiguous:
        part = np.ascontiguousarray(part)
        pitch = size
    memory = (ctypes.c_uint8 * (pitch * (len(part) - 1) + size)).from_address(part.ctypes.data)
    memory.part = part  # keeps it alive
    whole = memoryview(memory)
    return [whole[at : at + size] for at in range(0, pitch * len(part), pitch)]


def _place_of(address: int) -> tuple[int, int, int, int] | None:
    """Return the byte of a file that is mapped there, and the file's device and number."""
    try:
        with open("/proc/self/maps", encoding="utf-8", errors="replace") as maps:
            for line in maps:
                span, _, begin, device, number = line.split(maxsplit=5)[:5]
                first, end = (int(edge, 16) for edge in span.split("-"))
                if first <= address < end:
                    major, minor = (int(part, 16) for part in device.split(":"))
                    return int(begin, 16) + address - first, major, minor, int(number)
    except OSError:  # only Linux has this list
        pass
    return None
