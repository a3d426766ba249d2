"""Tiles as tasks of Dask: an array that is computed when its values are asked for."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np

from cvkern.scale.edges import Place, Seams, tile_edges

Inside = tuple[slice, slice]


def lazy_tiles(
    call: Any,
    source: Any,
    tiles: Any,
    options: dict[str, Any],
    mask: Any,
    like: tuple[list[tuple[int, ...]], list[np.dtype]],
) -> Any:
    """Return an array of Dask with a chunk for each tile, or a tuple of them.

    Each window is cut out of `source` before anything is computed, so a task holds the chunks that
    its window touches and nothing else. Without a `call`, the result is Canny's edges.
    """
    delayed: Any = import_module("dask").delayed
    seams = call is None
    shapes, dtypes = like
    work = delayed(_edges if seams else _filter, nout=2 if seams else len(shapes), pure=True)
    given = {} if seams else {"call": call}
    found = [
        work(
            source[tile.window],
            None if mask is None else mask[tile.window],
            inside=tile.inside,
            options=options,
            **given,
        )
        for tile in tiles
    ]
    if seams:
        inners = [tile.inner for tile in tiles]
        further = delayed(_further)(source.shape[:2], inners, [kept for _, kept in found])
        merge = delayed(_merge)
        found = [(merge(edges, further, n),) for n, (edges, _) in enumerate(found)]
    arrays = [
        _assembled([parts[k] for parts in found], [tile.inner for tile in tiles], shape[2:], dtype)
        for k, (shape, dtype) in enumerate(zip(shapes, dtypes, strict=True))
    ]
    return arrays[0] if len(arrays) == 1 else tuple(arrays)


def _filter(
    window: np.ndarray, mask: Any, *, inside: Inside, options: dict[str, Any], call: Any
) -> tuple[np.ndarray, ...]:
    found = call(np.ascontiguousarray(window), **options, **_masked(mask))
    return tuple(part[inside] for part in (found if isinstance(found, tuple) else (found,)))


def _edges(
    window: np.ndarray, mask: Any, *, inside: Inside, options: dict[str, Any]
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    return Seams.split(tile_edges(np.ascontiguousarray(window), **options, **_masked(mask))[inside])


def _masked(mask: Any) -> dict[str, np.ndarray]:
    return {} if mask is None else {"mask": np.ascontiguousarray(mask)}


def _further(
    shape: tuple[int, int], inners: list[Place], kept: list[dict[str, np.ndarray]]
) -> dict[int, np.ndarray]:
    """Return the places of edges that only the seams decide, by the number of the tile."""
    seams = Seams(shape)
    for inner, one in zip(inners, kept, strict=True):
        seams.add(inner, one)
    number = {(inner[0].start, inner[1].start): n for n, inner in enumerate(inners)}
    return {number[inner[0].start, inner[1].start]: places for inner, places in seams.decided()}


def _merge(edges: np.ndarray, further: dict[int, np.ndarray], number: int) -> np.ndarray:
    if number not in further:
        return edges
    merged = edges.copy()  # tasks must not write to what others may read
    merged.reshape(-1)[further[number]] = True
    return merged


def _assembled(
    parts: list[Any], inners: list[Place], channels: tuple[int, ...], dtype: np.dtype
) -> Any:
    """Return one array of tasks that give its tiles in raster order."""
    import dask.array as da

    blocks: list[list[Any]] = []
    for part, inner in zip(parts, inners, strict=True):
        sides = [side.stop - side.start for side in inner]
        if inner[1].start == 0:
            blocks.append([])
        blocks[-1].append(da.from_delayed(part, (*sides, *channels), dtype))
    return da.concatenate([da.concatenate(row, axis=1) for row in blocks], axis=0)
