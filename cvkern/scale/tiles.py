"""Functions over tiles of an image that need not fit into memory.

A tile is computed from a window, which has a halo of as many pixels as the function looks around a
pixel (`halos`). So the parts of the result that lie inside are those of the whole image, and tiles
may be computed in any order, on threads or by Dask. Canny's hysteresis looks arbitrarily far; its
edges are joined across the seams afterwards (`edges`).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

import cvkern
from cvkern._checks import check_integer, check_pair
from cvkern._runtime import refuse_capture
from cvkern.scale._lazy import lazy_tiles
from cvkern.scale.edges import Place, Seams, thresholds, tile_edges
from cvkern.scale.halos import halo
from cvkern.scale.journals import Journal

TILE = 2048


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
    progress: Callable[[int, int], object] | None = None,
    **options: Any,
) -> Any:
    """Apply a function tile by tile, in bounded memory.

    While one tile is computed, the next is read and the last is written.

    Parameters
    ----------
    function : function or str
        One of :data:`TILED`, or its name.
    source : array of shape (H, W) or (H, W, C)
        Anything with a `shape` that gives an array when it is sliced by rows and columns: a NumPy
        memory map, an array of Zarr or HDF5. For an array of Dask, tiles are tasks of Dask, which
        run where its scheduler says: on threads, or on the workers of a client.
    target : array of the result's shape, or a tuple of them, optional
        Anything that takes a tile when it is assigned to a slice. When omitted, NumPy arrays are
        allocated; of an array of Dask, one of Dask is returned, and nothing is computed yet.
        Functions with several results need one target for each.
    tile : int or (int, int), default 2048
        Height and width of a tile, pixels.
    journal : path, optional
        A folder that is made, in which finished tiles are noted. After a run that was killed, the
        same call goes on with the others. It is removed at the end. The function, its options and
        the shapes must be the same; pixels are not compared. Not for arrays of Dask, which
        computes the tasks of a lost worker again.
    progress : callable, optional
        Called with the number of finished tiles and that of all of them; not for arrays of Dask,
        which have progress bars of their own.
    **options
        As the function takes them. Of `mask`, the part of each tile is read.

    Returns
    -------
    array, or tuple of arrays
        `target`, or the arrays in its place. The values are those of the function on the whole
        image, in every bit.

    Raises
    ------
    TypeError
        If the function does not have an option, or the arrays hold no real numbers.
    ValueError
        If the function does not work tile by tile, an option has no meaning there
        (:func:`halo`), a shape is wrong, or `journal` is that of another call.

    Notes
    -----
    Besides the arrays of a tile, :func:`canny` keeps the weak pixels that reach the border of a
    tile without a strong one, packed; a last pass decides about them. With `use_quantiles`, two
    passes before find the thresholds.

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
    shape = _shape(source)
    sides = [check_integer(side, "tile", 1, 2**16) for side in check_pair(tile, "tile")]
    mask = options.pop("mask", None)
    if mask is not None and np.shape(mask) != shape[:2]:
        raise ValueError(f"mask must have shape {shape[:2]}, got {tuple(mask.shape)}")
    seams = Seams(shape[:2]) if name == "canny" else None
    call = tile_edges if seams else getattr(cvkern, name)
    tiles = list(tiles_of(shape[:2], sides, reach))
    if hasattr(source, "__dask_graph__"):
        if journal is not None or progress is not None:
            raise ValueError("journal and progress must be None for an array of Dask")
        if options.get("use_quantiles"):
            raise ValueError("use_quantiles must be False for an array of Dask: give thresholds")
        _, shapes, dtypes = results_of(name, source, **options)
        work = None if seams else call
        found = lazy_tiles(work, source, tiles, options, mask, (shapes, dtypes))
        return found if target is None else _store(found, target)
    plan = {"function": name, "shape": shape, "tile": sides, "options": options}
    book = Journal(journal, plan | {"masked": mask is not None})
    if book.begun and target is None:
        raise ValueError("target must be given to go on with a journal, got None")

    def read(tile: Tile) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        window = _cut(source, tile.window, "source")
        return window, {} if mask is None else {"mask": _cut(mask, tile.window, "mask")}

    def write(tile: Tile, results: tuple[np.ndarray, ...], kept: dict[str, np.ndarray]) -> None:
        for one, result in zip(targets, results, strict=True):
            one[tile.inner] = result
        book.note(tile.number, kept)

    if seams and options.get("use_quantiles"):
        low, high = thresholds(tiles, read, options)
        options |= {"low_threshold": low, "high_threshold": high, "use_quantiles": False}
    targets: list[Any] = []
    waiting = [t for t in tiles if book.kept(t.number) is None]
    with ThreadPoolExecutor(2) as pool:
        ahead = pool.submit(read, waiting[0]) if waiting else None
        written: Future[None] | None = None
        for n, part in enumerate(waiting):
            assert ahead is not None
            window, beside = ahead.result()
            if n + 1 < len(waiting):
                ahead = pool.submit(read, waiting[n + 1])
            found = call(window, **options, **beside)
            results = [r[part.inside] for r in (found if isinstance(found, tuple) else (found,))]
            kept = {}
            if seams:
                results[0], kept = seams.split(results[0])
            if not targets:
                targets += _targets(target, results, shape)
            if written:
                written.result()
            written = pool.submit(write, part, tuple(results), kept)
            if seams and journal is None:
                seams.add(part.inner, kept)
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
            targets[0][inner] = np.asarray(targets[0][inner]) | more
    book.remove()
    return targets[0] if len(targets) == 1 else tuple(targets)


def results_of(
    function: str, source: Any, **options: Any
) -> tuple[list[str], list[tuple[int, ...]], list[np.dtype]]:
    """Return the names, shapes and dtypes of the results; a single one has the name ""."""
    shape = _shape(source)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # one black pixel has no edges
        found = getattr(cvkern, function)(np.zeros((1, 1, *shape[2:]), source.dtype), **options)
    parts = found if isinstance(found, tuple) else (found,)
    names = list(getattr(found, "_fields", [str(n) for n in range(len(parts))]))
    shapes = [(*shape[:2], *part.shape[2:]) for part in parts]
    return names if len(parts) > 1 else [""], shapes, [part.dtype for part in parts]


def _store(results: Any, target: Any) -> Any:
    """Write arrays of Dask into the targets."""
    import dask.array as da

    arrays = results if isinstance(results, tuple) else (results,)
    # Dask writes under a lock: two tiles may lie in one chunk of the target.
    da.store(list(arrays), _checked(target, [a.shape for a in arrays], [a.dtype for a in arrays]))
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


def _cut(source: Any, window: Place, name: str) -> np.ndarray:
    try:
        part = source[window]
    except (TypeError, IndexError, NotImplementedError) as error:  # a memoryview has the last one
        got = type(source).__name__
        raise TypeError(
            f"{name} must give arrays for slices of rows and columns, got {got}"
        ) from error
    if isinstance(part, np.ma.MaskedArray):
        raise TypeError(f"{name} must not be masked, got {type(source).__name__}")
    return np.ascontiguousarray(part)


def _shape(source: Any) -> tuple[int, ...]:
    shape = getattr(source, "shape", None)
    if shape is None or len(shape) not in (2, 3) or 0 in shape:
        got = type(source).__name__ if shape is None else tuple(shape)
        raise ValueError(f"source must be an array of shape (H, W) or (H, W, C), got {got}")
    return tuple(int(n) for n in shape)


def _targets(target: Any, results: list[np.ndarray], shape: tuple[int, ...]) -> list[Any]:
    """Return an array for each result: those given, or new ones."""
    shapes = [(*shape[:2], *r.shape[2:]) for r in results]
    if target is None:
        return [np.empty(s, r.dtype) for s, r in zip(shapes, results, strict=True)]
    return _checked(target, shapes, [r.dtype for r in results])


def _checked(target: Any, shapes: list[tuple[int, ...]], dtypes: list[np.dtype]) -> list[Any]:
    """Return the targets as a list, if their shapes and dtypes are those of the results."""
    given = list(target) if isinstance(target, (tuple, list)) else [target]
    if [tuple(t.shape) for t in given] != shapes:
        got = ", ".join(str(tuple(t.shape)) for t in given)
        raise ValueError(f"target must have shape {', '.join(map(str, shapes))}, got {got}")
    for one, dtype in zip(given, dtypes, strict=True):
        if np.dtype(one.dtype) != dtype:
            raise ValueError(f"target must hold {dtype}, got {one.dtype}")
    return given
