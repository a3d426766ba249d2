"""Functions over tiles of an image that need not fit into memory.

A tile is computed from a window, which has a halo of as many pixels as the function looks around a
pixel (`halos`). So the parts of the result that lie inside are those of the whole image, and tiles
may be computed in any order, on threads or by Dask. Canny's hysteresis looks arbitrarily far; its
edges are joined across the seams afterwards (`edges`).
"""

from __future__ import annotations

import contextlib
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Any, NamedTuple

import numpy as np

import cvkern
from cvkern._checks import check_integer, check_pair
from cvkern._runtime import check_devices, choice, pinned, refuse_capture, use
from cvkern.scale._lazy import lazy_tiles
from cvkern.scale.edges import Place, Seams, add_edges, flooded, thresholds, tile_edges
from cvkern.scale.halos import halo
from cvkern.scale.journals import Journal
from cvkern.scale.sources import cut, images_of
from cvkern.scale.targets import check_targets
from cvkern.scale.votes import line_votes, shape_votes

TILE = 2048
MAPS = "mask", "orientation", "weights"  # options that are images, read tile by tile
VOTES = "generalized_hough", "generalized_hough_votes", "hough_line"  # sums over tiles
WHOLE = *VOTES, "stereo_match"  # functions of all tiles, or of two images
LEADING = ("hough_circle",)  # results whose last axes are rows and columns


class Tile(NamedTuple):
    """A part of the image, and the window with a halo from which it is computed."""

    number: int
    inner: tuple[slice, slice]
    """Rows and columns of the image that the tile fills."""
    window: tuple[slice, slice]
    """Rows and columns that are read."""
    inside: tuple[slice, slice]
    """Rows and columns of the window that the tile consists of."""


def apply(
    function: Any,
    source: Any,
    target: Any = None,
    *,
    tile: int | tuple[int, int] = TILE,
    journal: Any = None,
    devices: Sequence[str] | None = None,
    progress: Callable[[int, int], object] | None = None,
    **options: Any,
) -> Any:
    """Apply a function tile by tile, in bounded memory.

    While one tile is computed, the next is read and the last is written.

    Parameters
    ----------
    function : function or str
        One of :data:`TILED`, or its name.
    source : array of shape (H, W) or (H, W, C), or a tuple of two for `stereo_match`
        Anything with a `shape` that gives an array when it is sliced by rows and columns: a NumPy
        memory map, an array of Zarr or HDF5; or an image of pyvips. For an array of Dask, tiles are
        tasks of Dask, which run where its scheduler says: on threads, or on the workers of a
        client; not for the Hough transforms and `stereo_match`.
    target : array of the result's shape, or a tuple of them, optional
        Anything that takes a tile when it is assigned to a slice. When omitted, NumPy arrays are
        made; of an array of Dask, one of Dask is returned, and nothing is computed yet. Functions
        with several results need one target for each. It must not share memory with `source`.
        Space on disk for memory maps is taken first, where the system can. None for `hough_line`,
        `generalized_hough` and `generalized_hough_votes`, whose votes are added up in memory.
    tile : int or (int, int), default 2048
        Height and width of a tile, pixels; of `stereo_match`, strips have all columns.
    journal : path, optional
        A folder that is made, in which finished tiles are noted. After a run that was killed, the
        same call goes on with the others. It is removed at the end. The function, its options and
        the shapes must be the same; pixels are not compared. Not for arrays of Dask, which
        computes the tasks of a lost worker again.
    devices : sequence of str, optional
        Compute tiles on several GPUs in turn, such as ``("cuda:0", "cuda:1")``. Not for arrays of
        Dask.
    progress : callable, optional
        Called with the number of finished tiles and that of all of them; not for arrays of Dask.
    **options
        As the function takes them. Of `mask`, `orientation` and `weights`, the part of each tile
        is read.

    Returns
    -------
    array, or tuple of arrays
        `target`, or the arrays in its place as the function returns them; of functions of votes
        and `stereo_match`, what they return.
        The values are those of the function on the whole image, in every bit, except for
        `stereo_match` (see Notes).

    Raises
    ------
    TypeError
        If the function does not have an option, or the arrays hold no real numbers.
    ValueError
        If the function does not work tile by tile, an option has no meaning there
        (:func:`halo`), a shape is wrong, `source` changes its shape meanwhile, `target` shares its
        memory, or `journal` is that of another call.
    OSError
        If `source` cannot be read, or `target` or `journal` not be written.

    Notes
    -----
    Besides the arrays of a tile, :func:`canny` keeps the weak pixels that reach the border of a
    tile without a strong one, packed; a last pass decides about them. With `use_quantiles`, two
    passes before find the thresholds.

    :func:`generalized_hough` needs a mask of edges and their `orientation`. The edge points of all
    tiles are kept, and 2 bytes a pixel while poses are judged.

    Paths of :func:`stereo_match` go through the whole image. Strips read 64 rows more on each side,
    after which paths have mostly forgotten where they began; `max_bytes` cuts volumes in the same
    way. With the method 'window' and ``speckle_size=0``, values are those of the whole image where
    every row has a valid pixel.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> from cvkern.scale import apply
    >>> image = np.random.default_rng(0).integers(0, 256, (300, 500), np.uint8)
    >>> edges = apply("canny", image, tile=128, sigma=2)
    >>> bool((edges == cvkern.canny(image, 2)).all())
    True
    """
    refuse_capture("scale.apply")
    reach = halo(function, **options)
    name = function if isinstance(function, str) else function.__name__
    sources, shape = images_of(source, 2 if name == "stereo_match" else 1)
    sides = [check_integer(side, "tile", 1, 2**16) for side in check_pair(tile, "tile")]
    if name == "stereo_match":
        sides[1] = shape[1]
    maps = {key: options.pop(key) for key in MAPS if options.get(key) is not None}
    for key, values in maps.items():
        if np.shape(values) != shape[:2]:
            raise ValueError(f"{key} must have shape {shape[:2]}, got {np.shape(values)}")
    tiles = list(tiles_of(shape[:2], sides, reach))
    places = check_devices(devices)
    if hasattr(sources[0], "__dask_graph__"):
        if journal is not None or progress is not None:
            raise ValueError("journal and progress must be None for an array of Dask")
        return _lazy(name, source, target, tiles, options, maps)

    def read(tile: Tile) -> tuple[tuple[np.ndarray, ...], dict[str, np.ndarray]]:
        windows = tuple(cut(one, tile.window, "source") for one in sources)
        return windows, {key: cut(one, tile.window, key) for key, one in maps.items()}

    if name in VOTES:
        if journal is not None or target is not None:
            raise ValueError(f"journal and target must be None for {name}")
        if name == "hough_line":
            return line_votes(_told(tiles, read, progress), shape[:2], options)
        if "orientation" not in maps:
            raise ValueError("orientation must be given in tiles, with a mask of edges, got None")
        return shape_votes(name, _told(tiles, read, progress), shape[:2], options)
    seams = Seams(shape[:2]) if name == "canny" else None
    call = tile_edges if seams else getattr(cvkern, name)
    plan = {"function": name, "shape": shape, "tile": sides, "options": options}
    book = Journal(journal, plan | {"maps": sorted(maps)})
    if book.begun and target is None:
        raise ValueError("target must be given to go on with a journal, got None")

    inherited = pinned()

    def write(tile: Tile, results: list[np.ndarray], states: np.ndarray | None) -> None:
        for one, result in zip(targets, results, strict=True):
            one[_at(name, tile.inner)] = result
        kept = {}
        if seams and states is not None:
            with inherited():
                kept = seams.left(states, results[0])
            if journal is None:
                seams.add(tile.inner, kept)
        book.note(tile.number, kept)

    if seams and options.get("use_quantiles"):
        low, high = thresholds(tiles, read, options)
        options |= {"low_threshold": low, "high_threshold": high, "use_quantiles": False}
    targets: list[Any] = []
    found: Any = None
    waiting = [t for t in tiles if book.kept(t.number) is None]
    with ThreadPoolExecutor(1) as pool:
        written: Future[None] | None = None
        work = partial(call, **options)
        for n, (part, found) in enumerate(_computed(_ahead(waiting, read), work, places)):
            parts = found if isinstance(found, tuple) else (found,)
            results = [r[_at(name, part.inside)] for r in parts]
            states = None
            if seams:
                states = np.ascontiguousarray(results[0])
                results = [flooded(states)]
            if not targets:
                targets += _targets(name, target, results, shape, (*sources, *maps.values()))
            if written:
                written.result()
            written = pool.submit(write, part, results, states)
            if progress:
                progress(len(tiles) - len(waiting) + n + 1, len(tiles))
        if written:
            written.result()
    if not targets:
        targets += list(target) if isinstance(target, (tuple, list)) else [target]
    if seams:
        if journal is not None:
            for part in tiles:
                seams.add(part.inner, book.kept(part.number) or {})
        for inner, more in seams.decided():
            add_edges(targets[0], inner, more)
    book.remove()
    if hasattr(found, "_fields") and target is None:
        return type(found)(*targets)
    return targets[0] if len(targets) == 1 else tuple(targets)


def _lazy(
    name: str,
    source: Any,
    target: Any,
    tiles: list[Tile],
    options: dict[str, Any],
    maps: dict[str, Any],
) -> Any:
    """Return arrays of Dask for a source of Dask, or write them into the targets."""
    if name in WHOLE or name in LEADING:
        raise ValueError(f"source must not be an array of Dask for {name}")
    if options.get("use_quantiles"):
        raise ValueError("use_quantiles must be False for an array of Dask: give thresholds")
    _, shapes, dtypes = results_of(name, source, **options)
    call = None if name == "canny" else getattr(cvkern, name)
    found = lazy_tiles(call, source, tiles, options, maps.get("mask"), (shapes, dtypes))
    return found if target is None else _store(found, target)


def _ahead(tiles: list[Tile], read: Callable[[Tile], Any]) -> Iterator[tuple[Tile, Any]]:
    """Yield each tile with its pixels, while the next one is being read."""
    with ThreadPoolExecutor(1) as pool:
        coming = pool.submit(read, tiles[0]) if tiles else None
        for n, tile in enumerate(tiles):
            assert coming is not None
            found = coming.result()
            if n + 1 < len(tiles):
                coming = pool.submit(read, tiles[n + 1])
            yield tile, found


def _computed(
    coming: Iterator[tuple[Tile, Any]], call: Callable[..., Any], places: list[str]
) -> Iterator[tuple[Tile, Any]]:
    """Yield each tile with its results, in order; the devices take tiles in turn."""
    backend, _ = choice()  # other threads do not inherit it

    def on(place: str, windows: tuple[np.ndarray, ...], beside: dict[str, np.ndarray]) -> Any:
        with use(backend, place):
            return call(*windows, **beside)

    if len(places) == 1:
        for tile, (windows, beside) in coming:
            yield tile, on(places[0], windows, beside)
        return
    with contextlib.ExitStack() as stack:
        # A thread for each device, which keeps its scratch memory.
        threads = [stack.enter_context(ThreadPoolExecutor(1)) for _ in places]
        running: deque[tuple[Tile, Future[Any]]] = deque()
        for n, (tile, (windows, beside)) in enumerate(coming):
            at = n % len(places)
            running.append((tile, threads[at].submit(on, places[at], windows, beside)))
            if len(running) > len(places):
                first, future = running.popleft()
                yield first, future.result()
        for first, future in running:
            yield first, future.result()


def _told(
    tiles: list[Tile], read: Callable[[Tile], Any], progress: Callable[[int, int], object] | None
) -> Iterator[tuple[Tile, np.ndarray, dict[str, np.ndarray]]]:
    """Yield the tiles of one image with their pixels, and tell how many are finished."""
    for n, (tile, ((window,), beside)) in enumerate(_ahead(tiles, read)):
        yield tile, window, beside
        if progress:
            progress(n + 1, len(tiles))


def _at(function: str, place: Place) -> Any:
    """Return the index of rows and columns in a result of the function."""
    return (..., *place) if function in LEADING else place


def _whole(function: str, part: np.ndarray, shape: tuple[int, ...]) -> tuple[int, ...]:
    """Return the shape of a result for an image, given a part of it."""
    if function in LEADING:
        return (*part.shape[:-2], *shape[:2])
    return (*shape[:2], *part.shape[2:])


def results_of(
    function: str, source: Any, **options: Any
) -> tuple[list[str], list[tuple[int, ...]], list[np.dtype]]:
    """Return the names, shapes and dtypes of the results; a single one has the name ""."""
    if function in WHOLE:
        raise ValueError(f"function must have a result for each tile, got {function!r}")
    (source,), shape = images_of(source, 1)
    side = halo(function, **options) + 1 if function in LEADING else 1
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a black image has no edges
        found = getattr(cvkern, function)(
            np.zeros((side, side, *shape[2:]), source.dtype), **options
        )
    parts = found if isinstance(found, tuple) else (found,)
    names = list(getattr(found, "_fields", [str(n) for n in range(len(parts))]))
    shapes = [_whole(function, part, shape) for part in parts]
    return names if len(parts) > 1 else [""], shapes, [part.dtype for part in parts]


def _store(results: Any, target: Any) -> Any:
    """Write arrays of Dask into the targets."""
    import dask.array as da

    arrays = results if isinstance(results, tuple) else (results,)
    # Dask writes under a lock: two tiles may lie in one chunk of the target.
    shapes, dtypes = [a.shape for a in arrays], [a.dtype for a in arrays]
    da.store(list(arrays), check_targets(target, shapes, dtypes, ()))
    return target


def tiles_of(shape: tuple[int, ...], sides: list[int], reach: int) -> Iterator[Tile]:
    """Yield the tiles of an image in raster order."""
    rows, columns = (
        [(a, min(a + side, size)) for a in range(0, size, side)]
        for size, side in zip(shape, sides, strict=True)
    )
    for number, ((top, bottom), (left, right)) in enumerate((r, c) for r in rows for c in columns):
        outer = (
            slice(max(top - reach, 0), min(bottom + reach, shape[0])),
            slice(max(left - reach, 0), min(right + reach, shape[1])),
        )
        inner = slice(top, bottom), slice(left, right)
        inside = tuple(
            slice(i.start - o.start, i.stop - o.start) for i, o in zip(inner, outer, strict=True)
        )
        yield Tile(number, inner, outer, (inside[0], inside[1]))


def _targets(
    function: str,
    target: Any,
    results: list[np.ndarray],
    shape: tuple[int, ...],
    sources: Sequence[Any],
) -> list[Any]:
    """Return an array for each result: those given, or new ones."""
    shapes = [_whole(function, r, shape) for r in results]
    if target is None:
        return [np.empty(s, r.dtype) for s, r in zip(shapes, results, strict=True)]
    return check_targets(target, shapes, [r.dtype for r in results], sources)
