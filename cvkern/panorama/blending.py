"""Multi-band blending of a panorama, tile by tile, so that memory is bounded."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from cvkern._runtime import Runtime
from cvkern.kernels.codes.panorama import Part
from cvkern.panorama.registration import read_ahead
from cvkern.panorama.seams import Seams
from cvkern.panorama.surfaces import Canvas
from cvkern.panorama.warping import draw

TILES = {"cpu": 2048, "cuda": 4096}  # pixels of a tile's side, without its border
SURROUND = 3  # width of the border of a tile, in pixels of the coarsest band
REACH = 2  # width of the border of the visible part of an image, in the same unit
NOWHERE = (2**30, 2**30, -1, -1)


class Blend(NamedTuple):
    """Inputs of the blending."""

    images: list[Any]
    """The large images: arrays, or objects that `pixels` reads."""
    sides: np.ndarray
    """(N, 2) int32: heights and widths."""
    bands: int
    """Number of times that images are halved."""
    high: float
    """Largest value of an integer result; 0 for a float result."""
    channels: int


class Place(NamedTuple):
    """A tile of the canvas."""

    row: int
    column: int
    rows: int
    columns: int


def places_of(rt: Runtime, canvas: Canvas, bands: int, side: int | None = None) -> list[Place]:
    """Cut a canvas into tiles of about `side` pixels, in raster order."""
    side = side or TILES[rt.device.partition(":")[0]]
    side = max(1, side >> bands) << bands
    return [
        Place(row, column, min(side, canvas.height - row), min(side, canvas.width - column))
        for row in range(0, canvas.height, side)
        for column in range(0, canvas.width, side)
    ]


def blend(
    rt: Runtime,
    canvas: Canvas,
    seams: Seams,
    given: Blend,
    image: Any,
    mask: Any,
    say: Callable[[float], None],
) -> None:
    """Fill the kernel arrays `image` (H, W, C) and `mask` (H, W)."""
    places = places_of(rt, canvas, given.bands)
    for number, place in enumerate(places):
        say(number / len(places))
        blend_tile(rt, canvas, seams, given, place, place[:2], image, mask)


def blend_tile(
    rt: Runtime,
    canvas: Canvas,
    seams: Seams,
    given: Blend,
    place: Place,
    corner: tuple[int, int],
    image: Any,
    mask: Any,
) -> None:
    """Fill a part of the kernel arrays, which begins at a corner, with a tile of the canvas."""
    unit = 2**given.bands
    halo = SURROUND * unit
    row, column, rows, columns = place
    top, height = _with_halo(row, rows, halo, unit, canvas.height)
    # Columns of a closed canvas continue beyond its ends.
    left, width = _with_halo(column, columns, halo, unit, 0 if canvas.closed else canvas.width)
    tile = _Tile(rt, canvas, seams, given, top, left, height, width)
    part = Part(row - top, column - left, *corner, rows, columns)
    rt.panorama.blending.finish(tile.filled(), tile.labels, given.high, part, image, mask)


def _with_halo(first: int, count: int, halo: int, unit: int, size: int) -> tuple[int, int]:
    """Return the first row of a tile with its border, and its height: a multiple of `unit` rows.

    Nothing surrounds it beyond the canvas, of `size` rows unless that is 0.
    """
    begin, end = first - halo, first + count + halo
    if size:
        begin, end = max(begin, 0), min(end, size)
    return begin, -(-(end - begin) // unit) * unit


class _Tile:
    """A part of the canvas and its border."""

    def __init__(
        self,
        rt: Runtime,
        canvas: Canvas,
        seams: Seams,
        given: Blend,
        top: int,
        left: int,
        height: int,
        width: int,
    ):
        self.rt, self.canvas, self.seams, self.given = rt, canvas, seams, given
        self.top, self.left, self.height, self.width = top, left, height, width
        self.labels = rt.scratch("panorama.tile", (height, width), np.int32)
        # What the kernels need of all images is sent at once: each transfer waits for the kernels.
        self.cameras = rt.send("panorama.cameras", canvas.cameras())
        self.gains = rt.send("panorama.gains", seams.gains)
        self.columns = rt.send("panorama.columns", canvas.columns(left, width))
        self.rows = rt.send("panorama.rows", canvas.rows(top, height))
        self.parts = self._claimed()

    def _claimed(self) -> list[tuple[int, tuple[int, ...]]]:
        """Label the pixels; return each visible image and its bounds."""
        rt, canvas, coarse = self.rt, self.canvas, self.seams.coarse
        factor = coarse.step / canvas.step
        x = np.floor((self.left + np.arange(self.width) + 0.5) / factor).astype(np.int32)
        x = x % coarse.width if canvas.closed else x.clip(0, coarse.width - 1)
        y = np.floor((self.top + np.arange(self.height) + 0.5) / factor).astype(np.int32)
        names = np.array(self._near(), np.int32)
        if not len(names):
            names = np.zeros(1, np.int32)
        bounds = np.tile(np.array(NOWHERE, np.int32), (len(self.given.sides), 1))
        bounded = rt.scratch("panorama.bounds", bounds.shape, np.int32)
        rt.write(bounded, bounds)
        kernels = rt.panorama.warping
        kernels.claim(
            self.cameras, rt.send("panorama.sides", self.given.sides),
            rt.send("panorama.names", names), self.columns, self.rows, self.seams.labels,
            rt.send("panorama.coarse_columns", x),
            rt.send("panorama.coarse_rows", y.clip(0, coarse.height - 1)), self.labels,
        )  # fmt: skip
        kernels.bound(self.labels, bounded)
        found = rt.to_numpy(bounded)
        return [(n, tuple(map(int, found[n]))) for n in np.flatnonzero(found[:, 2] >= 0).tolist()]

    def _near(self) -> list[int]:
        """Return the images whose rectangles overlap the tile."""
        near = []
        for n, (x0, y0, x1, y1) in enumerate(self.canvas.rects):
            if y1 <= self.top or y0 >= self.top + self.height:
                continue
            shifts = (-1, 0, 1) if self.canvas.closed else (0,)
            for shift in (s * self.canvas.width for s in shifts):
                if x1 + shift > self.left and x0 + shift < self.left + self.width:
                    near.append(n)
                    break
        return near

    def filled(self) -> Any:
        """Return the blended tile, (C, height, width)."""
        rt, bands, channels = self.rt, self.given.bands, self.given.channels
        sizes = [(self.height >> level, self.width >> level) for level in range(bands + 1)]
        totals = [rt.scratch(f"panorama.total{k}", (channels, *s)) for k, s in enumerate(sizes)]
        sums = [rt.scratch(f"panorama.sum{k}", s) for k, s in enumerate(sizes)]
        for array in (*totals, *sums):
            rt.clear(array)
        given = [self.given.images[name] for name, _ in self.parts]
        with contextlib.closing(read_ahead(given)) as images:
            for image, (name, bounds) in zip(images, self.parts, strict=True):
                self._add(image, name, bounds, totals, sums)
        kernels = rt.panorama.blending
        for level in range(bands, -1, -1):
            coarser = totals[min(level + 1, bands)]
            kernels.collapse(sums[level], coarser, int(level == bands), totals[level])
        return totals[0]

    def _add(
        self, image: Any, name: int, bounds: tuple[int, ...], totals: list[Any], sums: list[Any]
    ) -> None:
        """Add the bands of one image."""
        rt, bands, channels = self.rt, self.given.bands, self.given.channels
        unit = 2**bands
        reach = REACH * unit if bands else 0
        top, left = (max(0, n - reach) // unit * unit for n in bounds[:2])
        bottom = min(self.height, -(-(bounds[2] + 1 + reach) // unit) * unit)
        right = min(self.width, -(-(bounds[3] + 1 + reach) // unit) * unit)
        height, width = bottom - top, right - left
        sizes = [(height >> level, width >> level) for level in range(bands + 1)]
        # The mask is the plane behind the colours: both are halved together.
        planes = [rt.scratch(f"panorama.band{k}", (channels + 1, *s)) for k, s in enumerate(sizes)]
        values, mask = planes[0][:channels], planes[0][channels]
        kernels = rt.panorama.blending
        # The weights are not needed here: the mask overwrites them.
        draw(
            rt, image, self.cameras[name : name + 1], self.gains[name],
            self.columns[left:right], self.rows[top:bottom], values, mask,
        )  # fmt: skip
        rt.panorama.warping.mark(self.labels, name, top, left, mask)
        for level in range(bands + 1):
            last = level == bands
            if not last:
                kernels.reduce(planes[level], planes[level + 1])
            kernels.add_band(
                planes[level], planes[min(level + 1, bands)], int(last), top >> level,
                left >> level, totals[level], sums[level],
            )  # fmt: skip
