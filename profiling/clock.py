"""Clocks that wait for the timed work, and the copy bandwidth of a device."""

from __future__ import annotations

import importlib
import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

COPY_BYTES = 512 << 20


class HostClock:
    """The CPU: a call has done its work when it returns."""

    def synchronize(self) -> None:
        pass

    def seconds(self, calls: Iterator[Callable[[], Any]], count: int) -> float:
        """Seconds a call, over `count` calls back to back."""
        begin = time.perf_counter()
        for _ in range(count):
            next(calls)()
        return (time.perf_counter() - begin) / count

    def copy(self, size: int) -> Callable[[], Any]:
        """Return a call that copies `size` bytes, on every core."""
        source, target = np.ones(size, np.uint8), np.empty(size, np.uint8)
        parts = list(zip(*(np.array_split(a, cores()) for a in (target, source)), strict=True))
        pool = ThreadPoolExecutor(len(parts))
        return lambda: list(pool.map(lambda part: np.copyto(*part), parts))


class CudaClock(HostClock):
    """A GPU: device events around the calls, and a wait for the whole device behind them."""

    def __init__(self) -> None:
        self._warp: Any = importlib.import_module("warp")
        self._warp.config.log_level = self._warp.LOG_ERROR
        self._warp.init()
        self._device = self._warp.get_device("cuda")
        # The legacy default stream: torch and CuPy use it unless told otherwise.
        self._stream = self._warp.Stream(self._device, cuda_stream=0)
        self._begin, self._end = (
            self._warp.Event(self._device, enable_timing=True) for _ in range(2)
        )

    def synchronize(self) -> None:
        self._warp.synchronize_device(self._device)

    def seconds(self, calls: Iterator[Callable[[], Any]], count: int) -> float:
        self.synchronize()
        begin = time.perf_counter()
        self._stream.record_event(self._begin)
        for _ in range(count):
            next(calls)()
        self._stream.record_event(self._end)
        self.synchronize()
        host = (time.perf_counter() - begin) / count
        events = self._warp.get_event_elapsed_time(self._begin, self._end) / 1e3 / count
        # Work on a stream of the library's own escapes the events; the host clock has waited for
        # the whole device, so it is right for any stream, and a little long.
        return events if host <= 1.05 * events else host

    def copy(self, size: int) -> Callable[[], Any]:
        warp = self._warp
        source = warp.full(size // 4, 1.5, dtype=warp.float32, device=self._device)
        target = warp.empty_like(source)
        return lambda: warp.copy(target, source, stream=self._stream)


def clock(device: str) -> HostClock:
    return CudaClock() if device == "cuda" else HostClock()


def copy_bandwidth(timer: HostClock, size: int = COPY_BYTES) -> float:
    """Bytes read plus bytes written a second by the best of several large copies."""
    call = timer.copy(size)
    call()
    return 2 * size / min(timer.seconds(iter([call] * 3), 3) for _ in range(5))


def cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
