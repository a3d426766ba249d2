"""How an image is cut into tiles."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

TILE = 2048  # height and width of a square tile, pixels
MOST_TILES = 2**22  # tiles of an image, which are listed
BAND = 2**26  # bytes of results of a row of tiles, which are written together
_ROWS = 1024  # smallest height of a wide tile
_AREA = 2**22  # elements of a wide tile; kernels are slower for rows of more than 4096 pixels
_AREA_GPU = 3 * 2**23  # elements of a tile on a GPU, for which the host waits
_ROWS_GPU = 256  # smallest height of a tile there
_HALOS = 16  # smallest ratio of the height of a tile to its halo


class Tile(NamedTuple):
    """A part of the image, and the window with a halo from which it is computed."""

    number: int
    inner: tuple[slice, slice]
    """Rows and columns of the image that the tile fills."""
    window: tuple[slice, slice]
    """Rows and columns that are read."""
    inside: tuple[slice, slice]
    """Rows and columns of the window that the tile consists of."""


def tiles_of(shape: tuple[int, ...], sides: Sequence[int], reach: int) -> Iterator[Tile]:
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


def sides_of(
    shape: tuple[int, ...],
    reach: int,
    targets: Sequence[Any],
    sources: Sequence[Any],
    on_gpu: bool = False,
) -> tuple[int, int]:
    """Return the height and width of the tiles of an image if the caller does not say.

    Chunks should be read and written once, so tiles are multiples of them. A row of wide tiles fits
    into memory, and can be written together. A GPU gets whole rows if it can, which are one piece
    of memory.
    """
    chunks = [c for c in map(chunks_of, (*targets, *sources)) if c is not None]
    if chunks:
        height, width = chunks[0]
        if width >= shape[1]:
            rows = max(1, TILE * TILE // int(np.prod(shape[1:])))
            return height * max(1, rows // height), shape[1]
        sides = (s * max(1, TILE // s) if s <= 2 * TILE else TILE for s in (height, width))
        return next(sides), next(sides)
    if not all(isinstance(array, np.ndarray) for array in (*targets, *sources)):
        return TILE, TILE
    channels = int(np.prod(shape[2:]))
    if on_gpu:
        rows = max(_AREA_GPU // (shape[1] * channels), _ROWS_GPU, _HALOS * reach)
        rows = min(rows, TILE)
        return rows, min(max(_AREA_GPU // (rows * channels), rows), shape[1])
    rows = min(max(_ROWS, _HALOS * reach), TILE)
    fitting = BAND // max(1, sum(t.nbytes // max(1, *t.shape[:1]) for t in targets))
    if fitting >= max(_ROWS // 8, _HALOS // 2 * reach):
        rows = min(rows, fitting)
    width = max(_AREA // (max(rows, _ROWS) * channels), rows)
    return rows, -(-shape[1] // -(-shape[1] // width))


def bands_of(tiles: list[Tile], columns: int) -> list[list[Tile]]:
    """Return the tiles row by row; those of rows that are not whole are alone."""
    rows = [list(row) for _, row in groupby(tiles, lambda tile: tile.inner[0].start)]
    bands: list[list[Tile]] = []
    for row in rows:
        whole = sum(tile.inner[1].stop - tile.inner[1].start for tile in row) == columns
        bands += [row] if whole else [[tile] for tile in row]
    return bands


def chunks_of(array: Any) -> tuple[int, int] | None:
    """Return the height and width of the pieces in which an array is stored, if it says so."""
    pieces = getattr(array, "shards", None) or getattr(array, "chunks", None)
    if (
        not isinstance(pieces, tuple)
        or len(pieces) < 2
        or not all(isinstance(n, (int, np.integer)) for n in pieces)
    ):
        return None
    return int(pieces[0]), int(pieces[1])
