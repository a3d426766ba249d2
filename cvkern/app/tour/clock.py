"""Timing of warm calls."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any, TypeVar

from cvkern.app.tour.page import Timing

T = TypeVar("T")
RUNS = 7
MOST = 2.0  # seconds of runs after which no further one begins


class Clock:
    """Call functions, and remember how long they take once they are warm."""

    def __init__(self) -> None:
        self._timings: list[Timing] = []

    def __call__(self, function: Callable[..., T], *images: Any, **options: Any) -> T:
        """Return ``function(*images, **options)``, and time it: the median of seven warm calls.

        Calls that take long are timed fewer times, but once at least.
        """
        result = function(*images, **options)  # compiles the kernels on a new machine
        seconds: list[float] = []
        while len(seconds) < RUNS and sum(seconds) < MOST:
            start = time.perf_counter()
            result = function(*images, **options)
            seconds.append(time.perf_counter() - start)
        said = ", ".join(f"{name}={value!r}" for name, value in options.items())
        self._timings.append(
            Timing(
                function.__name__,
                said,
                images[0].shape,
                images[0].dtype.name,
                1e3 * statistics.median(seconds),
                len(seconds),
            )
        )
        return result

    def take(self) -> tuple[Timing, ...]:
        """Return the timings since the last call of `take`."""
        timings, self._timings = tuple(self._timings), []
        return timings
