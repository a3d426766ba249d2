"""Tiles on their way: one thread reads ahead, and one writes while the next are computed.

Whoever takes less than all that one of these generators yields must close it, which waits for its
threads. Python would close it later, in any thread, and hang if that one is being started.
"""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

import numpy as np

from cvkern._runtime import choice, use
from cvkern.scale.grids import Tile

Read = tuple[tuple[np.ndarray, ...], dict[str, np.ndarray]]
"""The windows of a tile, and the parts of options that are images."""


Band = list[Tile]
"""Tiles of the same rows, side by side."""
T = TypeVar("T")
U = TypeVar("U")


def ahead(parts: list[T], read: Callable[[T], U]) -> Generator[tuple[T, U], None, None]:
    """Yield each part with its pixels, while the next one is being read."""
    with ThreadPoolExecutor(1) as pool:
        coming = pool.submit(read, parts[0]) if parts else None
        for n, part in enumerate(parts):
            assert coming is not None
            found = coming.result()
            if n + 1 < len(parts):
                coming = pool.submit(read, parts[n + 1])
            yield part, found


def computed(
    bands: list[Band],
    read: Callable[[Tile], Read],
    compute: Callable[[Band, list[Read]], T],
    places: list[str],
) -> Generator[tuple[Band, T], None, None]:
    """Yield each band with what was computed of it, in order; the devices take bands in turn."""
    backend, _ = choice()  # other threads do not inherit it

    def on(place: str, band: Band, found: list[Read]) -> T:
        with use(backend, place):
            return compute(band, found)

    with contextlib.ExitStack() as stack:
        coming = ahead(bands, lambda band: [read(tile) for tile in band])
        stack.callback(coming.close)
        if len(places) == 1:
            for band, found in coming:
                yield band, on(places[0], band, found)
            return
        # A thread for each device, which keeps its scratch memory.
        threads = [stack.enter_context(ThreadPoolExecutor(1)) for _ in places]
        running: deque[tuple[Band, Future[T]]] = deque()
        for n, (band, found) in enumerate(coming):
            at = n % len(places)
            running.append((band, threads[at].submit(on, places[at], band, found)))
            if len(running) > len(places):
                first, future = running.popleft()
                yield first, future.result()
        for first, future in running:
            yield first, future.result()


def written(
    found: Iterable[tuple[Band, T]], write: Callable[[Band, T], list[U]]
) -> Generator[tuple[Tile, U], None, None]:
    """Yield each tile with what `write` returns for it, while the next band is computed."""
    with ThreadPoolExecutor(1) as pool:
        last: tuple[Band, Future[list[U]]] | None = None
        for band, results in found:
            before, last = last, (band, pool.submit(write, band, results))
            del results
            if before:
                yield from zip(before[0], before[1].result(), strict=True)
        if last:
            yield from zip(last[0], last[1].result(), strict=True)


def told(
    tiles: list[Tile],
    read: Callable[[Tile], Read],
    progress: Callable[[int, int], object] | None,
) -> Generator[tuple[Tile, np.ndarray, dict[str, np.ndarray]], None, None]:
    """Yield the tiles of one image with their pixels, and tell how many are finished."""
    with contextlib.closing(ahead(tiles, read)) as coming:
        for n, (tile, ((window,), beside)) in enumerate(coming):
            yield tile, window, beside
            if progress:
                progress(n + 1, len(tiles))
