"""Tiles of images."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import cvkern.images
import cvkern.scale
from tests.fuzz.arguments import EDGES, Call, Draw, image, number, one, pair, whole


def halo(function: str, sigma: float, radius: int) -> Any:
    """Ask for a halo with options that may not be the function's."""
    return np.array(cvkern.scale.halo(function, sigma=sigma, radius=radius))


def tiled(name: str) -> Any:
    """Return a call of one function in tiles, and check it against the whole image."""

    def call(source: Any, tile: Any, **options: Any) -> Any:
        try:
            found = cvkern.scale.apply(name, source, tile=tile, **options)
        except (TypeError, ValueError) as error:  # some speak of the function's image
            raise type(error)(str(error).replace("image ", "source ")) from None
        whole = getattr(cvkern, name)(source, **options)
        if not np.array_equal(found, whole, equal_nan=found.dtype.kind == "f"):
            raise AssertionError(f"tiles of {name} differ from the whole image")
        return found

    return call


def mapped(paths: Any, radius: Any, suffix: Any) -> Any:
    """Find the medians of a few files; return the number of those done, kept and failed.

    A FileNotFoundError or an OSError leaves it where a path names no folder.
    """
    if not isinstance(paths, list) or not all(isinstance(a, np.ndarray) for a in paths):
        with tempfile.TemporaryDirectory() as folder:
            cvkern.scale.map_images(paths, "median", folder, suffix=suffix)
        return None
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder) / f"{n}.png" for n in range(len(paths))]
        _write(files, paths)
        options = {"suffix": suffix, "radius": radius}
        found = cvkern.scale.map_images(files, "median", folder + "/out", **options)
        again = cvkern.scale.map_images(files, "median", folder + "/out", **options)
        if again.kept != found.done or list(again.failed) != list(found.failed):
            raise AssertionError("the second run did something else")
        if found.failed and not found.done:
            raise ValueError("radius or suffix fails, as the report says of each file")
        return np.array([len(part) for part in found])


def stitched(paths: Any, tile: Any, bands: Any, scale: Any) -> Any:
    """Stitch a few files, and check the panoramas against those of the images in memory.

    A FileNotFoundError or an OSError leaves it where a path names no folder.
    """
    if not isinstance(paths, list) or not all(isinstance(a, np.ndarray) for a in paths):
        with tempfile.TemporaryDirectory() as folder:
            cvkern.scale.stitch(paths, folder)
        return None
    options = {"bands": bands, "scale": scale, "max_pixels": 10**6}
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder) / f"{n}.png" for n in range(len(paths))]
        _write(files, paths)
        found = cvkern.scale.stitch(files, folder + "/out", tile=tile, **options)
        whole = cvkern.stitch(paths, **options)
        for one_of, other in zip(found.panoramas, whole, strict=True):
            if one_of.members != other.members or one_of.pairs != other.pairs:
                raise AssertionError("files make another panorama than arrays")
            if not np.array_equal(one_of.mask, other.mask):
                raise AssertionError("tiles of a panorama cover something else")
            if tile is None and not np.array_equal(one_of.image, other.image):
                raise AssertionError("tiles of a panorama differ from the whole")
        return [np.array(one_of.image) for one_of in found.panoramas]


def grouped(paths: Any, data_range: Any) -> Any:
    """Find the groups of a few files, and check them against those of the images in memory.

    A FileNotFoundError or an OSError leaves it where a path names no folder.
    """
    if not isinstance(paths, list) or not all(isinstance(a, np.ndarray) for a in paths):
        cvkern.scale.recognize_panoramas(paths)
        return None
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder) / f"{n}.png" for n in range(len(paths))]
        _write(files, paths)
        found = cvkern.scale.recognize_panoramas(files, data_range=data_range)
    whole = cvkern.recognize_panoramas(paths, data_range=data_range)
    if found.components != whole.components:
        raise AssertionError("files make other groups than arrays")
    return [np.array(part) for part in found.components]


def _write(files: list[Path], pictures: list[Any]) -> None:
    for file, picture in zip(files, pictures, strict=True):
        try:
            cvkern.images.write_image(file, picture)
        except (TypeError, ValueError) as error:
            raise type(error)(f"paths: {error}") from None


def views(draw: Draw) -> list[np.ndarray]:
    """Return up to three parts of a picture that overlap."""
    spots = cvkern.gaussian(draw.rng.integers(0, 256, (48, 120), np.uint8), 2, dtype="uint8")
    wide = ((spots - 127.5) * 6 + 127.5).clip(0, 255).astype(np.uint8)
    return [wide[:, 28 * n : 28 * n + 64] for n in range(draw.rng.integers(4))]


def pictures(draw: Draw) -> list[np.ndarray]:
    """Return up to three small pictures."""
    return [draw.rng.integers(0, 256, (9, 12 + n), np.uint8) for n in range(draw.rng.integers(4))]


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
    "scale.map_images": Call(
        mapped,
        {"paths": pictures, "radius": whole(0, 4), "suffix": one(".npy", ".npz", ".tif", ".xyz")},
        {},
    ),
    "scale.stitch": Call(
        stitched,
        {"paths": views, "tile": one(None, 64, 0), "bands": one(None, 0, 2, 9),
         "scale": one(1.0, 0.5, -1.0)},
        {},
    ),
    "scale.recognize_panoramas": Call(
        grouped, {"paths": views, "data_range": one(None, 255.0, -1.0)}, {}
    ),
    "scale.halo": Call(
        halo,
        {"function": one("gaussian", "median", "canny", "x"), "sigma": number(0, 9),
         "radius": whole(0, 9)},
        {},
    ),
}  # fmt: skip
