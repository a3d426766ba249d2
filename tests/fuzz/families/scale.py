"""Tiles of images."""

from __future__ import annotations

from typing import Any

import numpy as np

import cvkern.scale
from tests.fuzz.arguments import EDGES, Call, Draw, image, number, one, pair, whole


def halo(function: str, sigma: float, radius: int) -> Any:
    """Ask for a halo with options that may not be the function's."""
    return np.array(cvkern.scale.halo(function, sigma=sigma, radius=radius))


def tiled(name: str) -> Any:
    """Return a call of one function in tiles, and check it against the whole image."""

    def call(source: Any, tile: Any, **options: Any) -> Any:
        found = cvkern.scale.apply(name, np.asarray(source), tile=tile, **options)
        whole = getattr(cvkern, name)(np.asarray(source), **options)
        if not np.array_equal(found, whole, equal_nan=found.dtype.kind == "f"):
            raise AssertionError(f"tiles of {name} differ from the whole image")
        return found

    return call


def source(draw: Draw) -> Any:
    """Return an image that is small, so that there are not too many tiles."""
    return image(draw, (min(draw.shape[0], 33), min(draw.shape[1], 40)))


TILES = {"source": source, "tile": pair(whole(3, 40))}
CALLS: dict[str, Call] = {
    "scale.apply canny": Call(
        tiled("canny"),
        {**TILES, "low_threshold": number(0, 40), "high_threshold": number(0, 90)},
        {name: make for name, make in EDGES.items() if name == "sigma"},
    ),
    "scale.apply gaussian": Call(tiled("gaussian"), TILES, {"sigma": pair(number(0, 8))}),
    "scale.apply median": Call(tiled("median"), TILES, {"radius": whole(0, 5)}),
    "scale.halo": Call(
        halo,
        {"function": one("gaussian", "median", "canny", "x"), "sigma": number(0, 9),
         "radius": whole(0, 9)},
        {},
    ),
}  # fmt: skip
