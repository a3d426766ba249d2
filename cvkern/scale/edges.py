"""Canny's edges over tiles: hysteresis inside each, and a last pass over what crosses their seams.

A weak pixel is an edge if weak pixels connect it with a strong one, however far away. In a tile,
this decides about all pixels but the weak ones that reach its border without a strong one. Pieces
of these are nodes of a graph. Two pieces that touch across a seam are joined, and a piece that
touches an edge across a seam is an edge.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from cvkern._runtime import runtime
from cvkern.edges.masks import canny_options, find_states
from cvkern.kernels.codes.edges import Edge

_EDGE = 1  # node of all pixels that are edges already; 0 is no node
Place = tuple[slice, slice]


def tile_edges(window: np.ndarray, **options: Any) -> np.ndarray:
    """Return the states of the pixels of a window, uint8."""
    image, checked = canny_options(window, **options)
    rt = runtime(image)
    states = rt.empty(tuple(image.shape[:2]), np.uint8)
    find_states(rt, image, checked, rt.adopt(states, np.uint8))
    return rt.release(states)


class Seams:
    """What tiles leave undecided."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.nodes = _EDGE + 1
        self.pairs: list[np.ndarray] = []
        self.pieces: list[tuple[Place, int, bytes]] = []
        self.above = np.zeros(shape[1], np.int64)  # nodes of the last row of the tiles above
        self.last = np.zeros(shape[1], np.int64)  # the same of the tiles of this row
        self.side = np.zeros(0, np.int64)  # nodes of the last column of the tile to the left

    def split(self, states: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Return the edges that a tile decides, and its undecided pixels, packed."""
        states = np.ascontiguousarray(states)
        edges = _flooded(states)
        weak = np.minimum(states, np.uint8(Edge.WEAK))
        rim = np.zeros(states.shape, bool)
        rim[[0, -1]] = rim[:, [0, -1]] = True
        weak[rim & (weak > 0)] = Edge.STRONG
        undecided = _flooded(weak) & ~edges
        packed = zlib.compress(np.packbits(undecided).tobytes(), 1)
        return edges, {
            "undecided": np.frombuffer(packed, np.uint8),
            "rows": edges[[0, -1]],
            "columns": edges[:, [0, -1]],
        }

    def add(self, tile: int, inner: Place, kept: dict[str, np.ndarray]) -> None:
        """Join the pieces of the next tile in raster order with those of its neighbours."""
        shape = inner[0].stop - inner[0].start, inner[1].stop - inner[1].start
        packed = kept["undecided"].tobytes()
        labels, count = _labels(packed, shape)
        nodes = np.where(labels > 0, labels.astype(np.int64) + (self.nodes - 1), 0)
        rows = np.where(kept["rows"], _EDGE, nodes[[0, -1]])
        columns = np.where(kept["columns"], _EDGE, nodes[:, [0, -1]])
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
            self.pieces.append((inner, self.nodes, packed))
            self.nodes += count

    def _join(self, one: np.ndarray, other: np.ndarray) -> None:
        """Note the pairs of nodes that touch across a seam, by sides or corners."""
        for a, b in ((one, other), (one[1:], other[:-1]), (one[:-1], other[1:])):
            touching = (a > 0) & (b > 0) & (a != b)
            if touching.any():
                self.pairs.append(np.unique(np.stack((a[touching], b[touching])), axis=1))

    def decided(self) -> Iterator[tuple[Place, np.ndarray]]:
        """Yield the tiles that have further edges, and these edges."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        if not self.pairs:
            return
        one, other = np.concatenate(self.pairs, axis=1)
        graph = coo_array((np.ones(len(one), bool), (one, other)), (self.nodes, self.nodes))
        _, component = connected_components(graph, directed=False)
        is_edge = component == component[_EDGE]
        for inner, first, packed in self.pieces:
            shape = inner[0].stop - inner[0].start, inner[1].stop - inner[1].start
            labels, count = _labels(packed, shape)
            chosen = np.concatenate(([False], is_edge[first : first + count]))
            if chosen.any():
                yield inner, chosen[labels]


def _flooded(states: np.ndarray) -> np.ndarray:
    """Return the pixels that weak ones connect with a strong one, bool."""
    rt = runtime(states)
    mask = rt.empty(states.shape, bool)
    rt.edges.masks.hysteresis(rt.adopt(states, np.uint8), rt.adopt(mask, bool))
    return rt.release(mask)


def _labels(packed: bytes, shape: tuple[int, int]) -> tuple[np.ndarray, int]:
    """Return the pieces of the undecided pixels of a tile, numbered from 1, and their number."""
    from scipy.ndimage import label

    bits = np.frombuffer(zlib.decompress(packed), np.uint8)
    undecided = np.unpackbits(bits, count=shape[0] * shape[1]).reshape(shape)
    labels = np.empty(shape, np.int32)
    label(undecided, np.ones((3, 3), int), output=labels)
    return labels, int(labels.max(initial=0))
