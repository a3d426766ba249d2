"""Functions over tiles of an image that need not fit into memory.

A tile is computed from a window, which has a halo of as many pixels as the function looks around a
pixel (`halos`). So the parts of the result that lie inside are those of the whole image, and tiles
may be computed in any order, on threads or by Dask. Canny's hysteresis looks arbitrarily far; its
edges are joined across the seams afterwards (`edges`).
"""

from __future__ import annotations

import contextlib
import math
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import cvkern
from cvkern._checks import check_integer, check_pair
from cvkern._runtime import check_devices, pinned, refuse_capture
from cvkern._whites import white_of_parts
from cvkern.scale._lazy import lazy_tiles
from cvkern.scale.edges import Place, Seams, add_edges, flooded, thresholds, tile_edges
from cvkern.scale.grids import BAND, MOST_TILES, TILE, Tile, bands_of, sides_of, tiles_of
from cvkern.scale.halos import halo
from cvkern.scale.journals import Journal
from cvkern.scale.mapped import let_go
from cvkern.scale.pipelines import Band, Read, computed, told, written
from cvkern.scale.sources import cut, images_of
from cvkern.scale.targets import Writer, check_targets, image_of
from cvkern.scale.votes import line_votes, shape_votes

MAPS = "mask", "orientation", "weights"  # options that are images, read tile by tile
VOTES = "generalized_hough", "generalized_hough_votes", "hough_line"  # sums over tiles
WHOLE = *VOTES, "stereo_match"  # functions of all tiles, or of two images
LEADING = ("hough_circle",)  # results whose last axes are rows and columns


def apply(
    function: Any,
    source: Any,
    target: Any = None,
    *,
    tile: int | tuple[int, int] | None = None,
    journal: Any = None,
    devices: Sequence[str] | None = None,
    progress: Callable[[int, int], object] | None = None,
    **options: Any,
) -> Any:
    """Apply a function tile by tile, in bounded memory.

    While some tiles are computed, the next are read and the last are written.

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
    tile : int or (int, int), optional
        Height and width of a tile, pixels; of `stereo_match`, strips have all columns. By default,
        multiples of the chunks in which an array is stored, near 2048; for arrays of NumPy and
        memory maps, 1024 x 4096 or, for wide halos, more rows and fewer columns; on a GPU, whole
        rows of 25 million elements in all.
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
        (:func:`halo`), a shape is wrong, there are more than 2^22 tiles, `source` changes its shape
        meanwhile or has damaged parts, `target` shares its memory, or `journal` is that of another
        call.
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
    every row has a valid pixel. Without `data_range`, a pass before finds the white of both images.

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
    maps = {key: options.pop(key) for key in MAPS if options.get(key) is not None}
    for key, values in maps.items():
        if np.shape(values) != shape[:2]:
            raise ValueError(f"{key} must have shape {shape[:2]}, got {np.shape(values)}")
    lazy = hasattr(sources[0], "__dask_graph__")
    places = check_devices(devices)
    sides = _sides(
        name, tile, shape, reach, _listed(target), () if lazy else sources, places[0] != "cpu"
    )
    count = math.prod(-(-n // side) for n, side in zip(shape, sides, strict=False))
    if count > MOST_TILES:
        raise ValueError(f"tile must give at most {MOST_TILES} tiles, got {sides} for {shape}")
    tiles = list(tiles_of(shape[:2], sides, reach))
    if lazy:
        if journal is not None or progress is not None:
            raise ValueError("journal and progress must be None for an array of Dask")
        return _lazy(name, source, target, tiles, options, maps)

    def read(tile: Tile) -> Read:
        windows = tuple(cut(one, tile.window, "source") for one in sources)
        return windows, {key: cut(one, tile.window, key) for key, one in maps.items()}

    if name in VOTES:
        if journal is not None or target is not None:
            raise ValueError(f"journal and target must be None for {name}")
        if name != "hough_line" and "orientation" not in maps:
            raise ValueError("orientation must be given in tiles, with a mask of edges, got None")
        with contextlib.closing(told(tiles, read, progress)) as parts:
            if name == "hough_line":
                return line_votes(parts, shape[:2], options)
            return shape_votes(name, parts, shape[:2], options)
    seams = Seams(shape[:2]) if name == "canny" else None
    plan = {"function": name, "shape": shape, "tile": sides, "options": options}
    book = Journal(journal, plan | {"maps": sorted(maps)})
    if book.begun and target is None:
        raise ValueError("target must be given to go on with a journal, got None")

    if seams and options.get("use_quantiles"):
        low, high = thresholds(tiles, read, options)
        options |= {"low_threshold": low, "high_threshold": high, "use_quantiles": False}
    if name == "stereo_match" and options.get("data_range") is None:
        options |= {"data_range": _white_of_pair(sources, tiles)}
    with _Job(name, target, shape, sides, (*sources, *maps.values()), options) as job:
        waiting = [t for t in tiles if book.kept(t.number) is None]
        bands = bands_of(waiting, shape[1] if job.gathers else 0)
        with (
            contextlib.closing(computed(bands, read, job.compute, places)) as found,
            contextlib.closing(written(found, job.write)) as parts,
        ):
            for n, (part, kept) in enumerate(parts):
                if seams and journal is None:
                    seams.add(part.inner, kept)
                book.note(part.number, kept)
                if progress:
                    progress(len(tiles) - len(waiting) + n + 1, len(tiles))
        targets = [writer.target for writer in job.writers]
        if seams:
            if journal is not None:
                for part in tiles:
                    seams.add(part.inner, book.kept(part.number) or {})
            for inner, more in seams.decided():
                add_edges(targets[0], inner, more)
    book.remove()
    if hasattr(job.kind, "_fields") and target is None:
        return job.kind(*targets)
    return targets[0] if len(targets) == 1 else tuple(targets)


def _white_of_pair(sources: Sequence[Any], tiles: list[Tile]) -> float | None:
    """Return the white of a pair of images; None if they differ in dtype, so that each has one."""
    first = [cut(one, tiles[0].inner, "source").dtype for one in sources]
    if len(set(first)) > 1 or first[0].kind not in "iuf":
        return None
    return max(white_of_parts(cut(one, tile.inner, "source") for tile in tiles) for one in sources)


class _Job:
    """What is done with the tiles of a band: they are computed, then written."""

    def __init__(
        self,
        name: str,
        target: Any,
        shape: tuple[int, ...],
        sides: Sequence[int],
        sources: Sequence[Any],
        options: dict[str, Any],
    ) -> None:
        self.name, self.options, self.sources = name, options, sources
        self.given = target, shape
        self.call = tile_edges if name == "canny" else getattr(cvkern, name)
        self.kind: type = type(None)  # the type of the results
        self.inherited = pinned()
        self.open, self.ready = contextlib.ExitStack(), False
        self.writers = self._writers(_listed(target))
        size = sides[0] * sum(w.image.nbytes // len(w.image) for w in self.writers if w.rows)
        self.gathers = bool(self.writers) and size <= BAND and all(w.rows for w in self.writers)

    def __enter__(self) -> _Job:
        return self

    def __exit__(self, *exc: object) -> None:
        self.open.close()

    def compute(self, band: Band, read: list[Read]) -> list[tuple[np.ndarray, ...]]:
        """Return the results of each tile; of `canny`, the states of the pixels and the edges."""
        found = []
        for tile, (windows, beside) in zip(band, read, strict=True):
            result = self.call(*windows, **self.options, **beside)
            self.kind = type(result)
            parts = result if isinstance(result, tuple) else (result,)
            parts = tuple(part[_at(self.name, tile.inside)] for part in parts)
            if self.name == "canny":
                states = np.ascontiguousarray(parts[0])
                parts = states, flooded(states)
            found.append(parts)
        return found

    def write(self, band: Band, found: list[tuple[np.ndarray, ...]]) -> list[dict[str, np.ndarray]]:
        """Write tiles; return what is kept of Canny's edges at their seams."""
        left: list[dict[str, np.ndarray]] = [{} for _ in band]
        if self.name == "canny":
            with self.inherited():
                left = [Seams.left(states, edges) for states, edges in found]
            found = [(edges,) for _, edges in found]
        if not self.ready:
            self._check(found[0])
        places = [_at(self.name, tile.inner) for tile in band]
        for writer, parts in zip(self.writers, zip(*found, strict=True), strict=True):
            writer.write(places, parts)
        if band[-1].inner[1].stop == self.given[1][1]:
            for writer in self.writers:
                writer.let_go(band[0].inner[0])
            for source in self.sources:
                let_go(source, band[0].inner[0])
        return left

    def _check(self, results: Sequence[np.ndarray]) -> None:
        """Refuse targets that do not fit; make those that were not given."""
        target, shape = self.given
        targets = _targets(self.name, target, results, shape, self.sources)
        self.writers = self.writers or self._writers(targets)
        self.ready = True

    def _writers(self, targets: list[Any]) -> list[Writer]:
        writers = [Writer(one) for one in targets]
        for writer in writers:
            self.open.callback(writer.close)
        return writers


def _listed(target: Any) -> list[Any]:
    if target is None:
        return []
    return list(target) if isinstance(target, (tuple, list)) else [target]


def _sides(
    name: str,
    tile: Any,
    shape: tuple[int, ...],
    reach: int,
    targets: list[Any],
    sources: Sequence[Any],
    on_gpu: bool,
) -> list[int]:
    """Return the height and width of the tiles."""
    if tile is None:
        squares = not sources or name in LEADING or name == "stereo_match"
        images = [image_of(t) for t in targets]
        sides = [TILE, TILE] if squares else [*sides_of(shape, reach, images, sources, on_gpu)]
    else:
        sides = [check_integer(side, "tile", 1, 2**16) for side in check_pair(tile, "tile")]
    if name == "stereo_match":
        sides[1] = shape[1]
    return sides


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


def _targets(
    function: str,
    target: Any,
    results: Sequence[np.ndarray],
    shape: tuple[int, ...],
    sources: Sequence[Any],
) -> list[Any]:
    """Return an array for each result: those given, or new ones."""
    shapes = [_whole(function, r, shape) for r in results]
    if target is None:
        return [np.empty(s, r.dtype) for s, r in zip(shapes, results, strict=True)]
    return check_targets(target, shapes, [r.dtype for r in results], sources)
