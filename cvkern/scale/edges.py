"""Canny's edges over tiles: hysteresis inside each, and a last pass over what crosses their seams.

A weak pixel is an edge if weak pixels connect it with a strong one, however far away. In a tile,
this decides about all pixels but the weak ones that reach its border without a strong one. Pieces
of these are nodes of a graph. Two pieces that touch across a seam are joined, and a piece that
touches an edge across a seam is an edge.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from inspect import signature
from typing import Any, NamedTuple

import numpy as np

from cvkern._runtime import runtime
from cvkern.edges.masks import EdgeOptions, canny, canny_options, find_states
from cvkern.edges.quantiles import ranks_of
from cvkern.edges.slopes import find_slopes
from cvkern.kernels.codes.edges import Edge, Norm, Thinning

_FEW = 4096  # undecided pixels of a tile beyond which a flood of it is faster
_EDGE = 1  # node of all pixels that are edges already; 0 is no node
Place = tuple[slice, slice]


def tile_edges(window: np.ndarray, **options: Any) -> np.ndarray:
    """Return the states of the pixels of a window, uint8."""
    image, checked = _checked(window, options)
    rt = runtime(image)
    states = rt.empty(tuple(image.shape[:2]), np.uint8)
    find_states(rt, image, checked, rt.adopt(states, np.uint8))
    return rt.release(states)


def _checked(window: np.ndarray, options: dict[str, Any]) -> tuple[Any, EdgeOptions]:
    given = signature(canny).bind(window, **options)
    given.apply_defaults()
    return canny_options(*given.args, **given.kwargs)


def thresholds(
    tiles: list[Any], read: Callable[[Any], tuple[Any, Any]], options: dict[str, Any]
) -> tuple[float, float]:
    """Return the two quantiles of the gradient's length in an image, as exact thresholds.

    `options` are those of :func:`canny`, and `read` gives the windows of a tile and its mask. The
    bits of floats >= 0 have the order of their values: a first pass counts their upper halves, a
    second one the lower halves of those whose upper half is that of the order statistic.
    """
    count = np.zeros(2**15, np.int64)
    for tile in tiles:
        count += np.bincount(_lengths(tile, read, options) >> 16, minlength=len(count))
    _, checked = _checked(read(tiles[0])[0][0], options)
    strict = checked.rule != Thinning.FRAMED
    ranks = ranks_of(checked.thresholds, int(count.sum()), strict)
    upper = [int(np.searchsorted(np.cumsum(count), rank, side="right")) for rank in ranks]
    left = [rank - int(count[:digit].sum()) for rank, digit in zip(ranks, upper, strict=True)]
    lower = np.zeros((2, 2**16), np.int64)
    for tile in tiles:
        bits = _lengths(tile, read, options)
        for one, digit in zip(lower, upper, strict=True):
            one += np.bincount(bits[bits >> 16 == digit] & 0xFFFF, minlength=len(one))
    found = [
        digit << 16 | int(np.searchsorted(np.cumsum(one), rank, side="right"))
        for one, digit, rank in zip(lower, upper, left, strict=True)
    ]
    values = np.array(found, np.int32).view(np.float32).astype(np.float64)
    # The square of such a root rounds to the float32 that the root was taken of.
    low, high = values if checked.norm == Norm.L1 else np.sqrt(values)
    return float(low), float(high)


def _lengths(tile: Any, read: Callable[[Any], tuple[Any, Any]], options: dict[str, Any]) -> Any:
    """Return the bits of the lengths of gradients in a tile, int32; thresholds compare these."""
    (window,), beside = read(tile)
    image, checked = _checked(window, options | beside)
    rt = runtime(image, checked.around.mask)
    shape = tuple(image.shape[:2])
    slopes = rt.scratch("canny.dy", shape), rt.scratch("canny.dx", shape)
    bare = checked.rule == Thinning.SECTORS and checked.around.mask is None
    given = checked.sigma, checked.operator, checked.around, bare, checked.norm
    find_slopes(rt, image, *given, *slopes)
    dy, dx = (rt.to_numpy(slope)[tile.inside] for slope in slopes)
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.abs(dx) + np.abs(dy) if checked.norm == Norm.L1 else dy * dy + dx * dx
    return np.where(length > 0, length, np.float32(0)).view(np.int32).ravel()


class Piece(NamedTuple):
    """The undecided pixels of a tile."""

    inner: Place
    first: int
    """The node of its first piece."""
    number: int
    """The number of its pieces."""
    packed: bytes


class Seams:
    """What tiles leave undecided."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.nodes = _EDGE + 1
        self.pairs: list[np.ndarray] = []
        self.pieces: list[Piece] = []
        self.above = np.zeros(shape[1], np.int64)  # nodes of the last row of the tiles above
        self.last = np.zeros(shape[1], np.int64)  # the same of the tiles of this row
        self.side = np.zeros(0, np.int64)  # nodes of the last column of the tile to the left

    @staticmethod
    def split(states: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Return the edges that a tile decides, and the pixels that it leaves undecided."""
        states = np.ascontiguousarray(states)
        edges = flooded(states)
        return edges, Seams.left(states, edges)

    @staticmethod
    def left(states: np.ndarray, edges: np.ndarray) -> dict[str, np.ndarray]:
        """Return the border of the edges of a tile, and its undecided pixels, packed.

        `states` loses these pixels.
        """
        kept = {"rows": edges[[0, -1]], "columns": edges[:, [0, -1]]}
        places = _reaching(states, edges)
        packed = zlib.compress(np.diff(places, prepend=np.int32(0)).tobytes(), 1)
        return {**kept, "undecided": np.frombuffer(packed, np.uint8)}

    def add(self, inner: Place, kept: dict[str, np.ndarray]) -> None:
        """Join the pieces of the next tile in raster order with those of its neighbours."""
        shape = _sides(inner)
        packed = kept["undecided"].tobytes()
        places, labels, count = _labelled(packed, shape[1])
        rows, columns = (np.where(kept[name], _EDGE, 0) for name in ("rows", "columns"))
        y, x = np.divmod(places, shape[1])
        for side, (row, column) in enumerate(((0, 0), (shape[0] - 1, shape[1] - 1))):
            rows[side, x[y == row]] = self.nodes + labels[y == row]
            columns[y[x == column], side] = self.nodes + labels[x == column]
        if inner[1].start == 0:
            self.above, self.last = self.last, np.zeros_like(self.last)
        else:
            self._join(self.side, columns[:, 0])
        if inner[0].start > 0:
            # One pixel more on both sides, for neighbours by a corner.
            left, right = max(inner[1].start - 1, 0), inner[1].stop + 1
            beyond = self.above[left:right]
            first = np.zeros(len(beyond), np.int64)
            first[inner[1].start - left :][: shape[1]] = rows[0]
            self._join(beyond, first)
        self.last[inner[1]] = rows[1]
        self.side = columns[:, 1]
        if count:
            self.pieces.append(Piece(inner, self.nodes, count, packed))
            self.nodes += count

    def _join(self, one: np.ndarray, other: np.ndarray) -> None:
        """Note the pairs of nodes that touch across a seam, by sides or corners."""
        for a, b in ((one, other), (one[1:], other[:-1]), (one[:-1], other[1:])):
            touching = (a > 0) & (b > 0) & (a != b)
            if touching.any():
                self.pairs.append(np.unique(np.stack((a[touching], b[touching])), axis=1))

    def decided(self) -> Iterator[tuple[Place, np.ndarray]]:
        """Yield the tiles that have further edges, and the places of these, row by row."""
        if not self.pairs:
            return
        component = _components(np.concatenate(self.pairs, axis=1), self.nodes)
        is_edge = component == component[_EDGE]
        for inner, first, count, packed in self.pieces:
            if is_edge[first : first + count].any():
                places, labels, _ = _labelled(packed, _sides(inner)[1])
                yield inner, places[is_edge[first + labels]]


def add_edges(target: Any, inner: Place, places: np.ndarray) -> None:
    """Add further edges of a tile to the edges of the image."""
    tile = target[inner]
    own = isinstance(target, np.ndarray)  # then the tile is a part of it
    tile = tile if own else np.array(tile)
    tile[np.divmod(places, tile.shape[1])] = True
    if not own:
        target[inner] = tile


def _sides(place: Place) -> tuple[int, int]:
    return place[0].stop - place[0].start, place[1].stop - place[1].start


def flooded(states: np.ndarray) -> np.ndarray:
    """Return the pixels that weak ones connect with a strong one, bool."""
    rt = runtime(states)
    mask = rt.empty(states.shape, bool)
    rt.edges.masks.hysteresis(rt.adopt(states, np.uint8), rt.adopt(mask, bool))
    return rt.release(mask)


def _reaching(states: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return the places of weak pixels, no edges, that weak ones connect with the border, int32.

    As a rule they are few and near the border, so they are looked up one by one. `states` loses
    them then.
    """
    height, width = states.shape
    pair = states.reshape(-1), edges.reshape(-1).view(np.uint8)
    weak, decided = (memoryview(a) for a in pair)  # pyright: ignore[reportArgumentType]
    begins = [
        first + step * np.flatnonzero((states[side] == Edge.WEAK) & ~edges[side])
        for side, first, step in (
            (np.s_[0], 0, 1),
            (np.s_[-1], (height - 1) * width, 1),
            (np.s_[:, 0], 0, width),
            (np.s_[:, -1], width - 1, width),
        )
    ]
    front, found = np.concatenate(begins).tolist(), []
    state = int(Edge.WEAK)
    while front and len(found) < _FEW:
        place = front.pop()
        if weak[place] != state:  # found already
            continue
        weak[place] = Edge.NONE
        found.append(place)
        y, x = divmod(place, width)
        for row in range(max(y - 1, 0) * width, min(y + 2, height) * width, width):
            for near in range(row + max(x - 1, 0), row + min(x + 2, width)):
                if weak[near] == state and not decided[near]:
                    front.append(near)
    if not front:
        return np.sort(np.array(found, np.int32))
    flat = states.reshape(-1)
    flat[found] = Edge.WEAK
    left = np.where(edges, np.uint8(Edge.NONE), states)
    for side in (left[0], left[-1], left[:, 0], left[:, -1]):
        side[side > 0] = Edge.STRONG
    return np.flatnonzero(flooded(left)).astype(np.int32)


def _labelled(packed: bytes, width: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Return the undecided pixels of a tile, the piece of each, and the number of pieces."""
    steps = np.frombuffer(zlib.decompress(packed), np.int32)
    places = np.cumsum(steps, dtype=np.int64)
    return places, *_pieces(places, width)


def _pieces(places: np.ndarray, width: int) -> tuple[np.ndarray, int]:
    """Return the piece of each pixel, given ascending places, and the number of pieces."""
    column = places % width
    pairs = []
    for step, ends in ((1, width - 1), (width - 1, 0), (width, -1), (width + 1, width - 1)):
        at = np.searchsorted(places, places + step)
        found = at < len(places)
        found[found] = places[at[found]] == places[found] + step
        found &= column != ends
        pairs.append(np.stack((np.flatnonzero(found), at[found])))
    labels = _components(np.concatenate(pairs, axis=1), len(places))
    return labels, int(labels.max(initial=-1)) + 1


def _components(pairs: np.ndarray, nodes: int) -> np.ndarray:
    """Return the number of the component of each node of a graph with these edges."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(pairs.shape[1], bool), tuple(pairs)), (nodes, nodes))
    return connected_components(graph, directed=False)[1] if nodes else np.zeros(0, np.int32)
