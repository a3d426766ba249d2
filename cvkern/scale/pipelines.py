"""Tiles on their way: read ahead by one thread, computed and written by several."""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

import numpy as np

from cvkern._runtime import choice, use
from cvkern.kernels._threads import share_cores
from cvkern.scale.grids import Tile

WORKERS = 2  # bands that are computed and written at once on each device; each needs its memory

Read = tuple[tuple[np.ndarray, ...], dict[str, np.ndarray]]
"""The windows of a tile, and the parts of options that are images."""


Band = list[Tile]
"""Tiles of the same rows, side by side."""
T = TypeVar("T")
U = TypeVar("U")


def ahead(parts: list[T], read: Callable[[T], U]) -> Iterator[tuple[T, U]]:
    """Yield each part with what was read of it, while the next one is being read."""
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
    job: Callable[[Band, list[Read]], list[U]],
    places: list[str],
) -> Iterator[tuple[Tile, U]]:
    """Yield each tile with what its job returns, in order; the devices take bands in turn.

    A band has steps that use one core, or wait for a disk. So each device computes several at once,
    and on the CPU these share its cores.
    """
    backend, _ = choice()  # other threads do not inherit it
    workers = min(WORKERS, -(-len(bands) // len(places)))
    share = workers * len(places)

    def on(place: str, band: Band, found: list[Read]) -> Iterator[tuple[Tile, U]]:
        with use(backend, place):
            return zip(band, job(band, found), strict=True)

    coming = ahead(bands, lambda band: [read(tile) for tile in band])
    if share <= 1:
        for band, found in coming:
            yield from on(places[0], band, found)
        return
    with contextlib.ExitStack() as stack:
        pools = [
            stack.enter_context(ThreadPoolExecutor(workers, "tiles", share_cores, (share,)))
            for _ in places
        ]
        running: deque[Future[Iterator[tuple[Tile, U]]]] = deque()
        for n, (band, found) in enumerate(coming):
            at = n % len(places)
            running.append(pools[at].submit(on, places[at], band, found))
            del found
            if len(running) > share:
                yield from running.popleft().result()
        for future in running:
            yield from future.result()


def told(
    tiles: list[Tile],
    read: Callable[[Tile], Read],
    progress: Callable[[int, int], object] | None,
) -> Iterator[tuple[Tile, np.ndarray, dict[str, np.ndarray]]]:
    """Yield the tiles of one image with what was read, and tell how many are finished."""
    for n, (tile, ((window,), beside)) in enumerate(ahead(tiles, read)):
        yield tile, window, beside
        if progress:
            progress(n + 1, len(tiles))
