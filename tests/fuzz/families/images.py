"""Pictures: drawing, colour maps, and files."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import cvkern.images
from tests.fuzz.arguments import (
    Call,
    Draw,
    channels,
    colour,
    image,
    mask,
    maybe,
    number,
    one,
    one_of,
    rows,
)

WIDTH = one(0.5, 2.0, 30.0, 1e6, 1e300)
COLOR = one((1, 2, 3), (300, 0, 0), (1, 2), 7)


def written(image: Any, name: Any) -> np.ndarray:
    """Write an image and read it again."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name if isinstance(name, str) else name
        try:
            cvkern.images.write_image(path, image)
            return cvkern.images.read_image(path)
        except (OSError, ValueError, TypeError) as error:  # its docstring names all of them
            raise ValueError(str(error).replace(folder, "")) from None


def read(content: bytes) -> np.ndarray:
    """Read a file of any content."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "some.png"
        try:
            path.write_bytes(content)
        except TypeError:
            raise TypeError("content") from None
        try:
            return cvkern.images.read_image(path)
        except (OSError, ValueError, TypeError) as error:  # its docstring names all of them
            raise ValueError(str(error).replace(folder, "")) from None


def harmed(draw: Draw) -> bytes:
    """Return an image file, a few of whose bytes are others."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"some.{draw.pick(['png', 'jpg', 'tif', 'bmp', 'webp'])}"
        pixels = draw.rng.integers(0, 256, (*draw.shape, 3)).astype(np.uint8)
        cvkern.images.write_image(path, pixels)
        content = bytearray(path.read_bytes())
    for _ in range(int(draw.rng.integers(0, 4))):
        content[int(draw.rng.integers(min(len(content), draw.pick([64, 2**30]))))] ^= int(
            draw.rng.integers(1, 256)
        )
    return bytes(content[: len(content) if draw.odd(0.7) else draw.rng.integers(len(content))])


CALLS: dict[str, Call] = {
    "images.apply_colormap": Call(
        cvkern.images.apply_colormap,
        {"values": image},
        {
            "name": one("sequential", "cyclic", "diverging", "none"),
            "vmin": maybe(number(-9, 9)),
            "vmax": maybe(number(-9, 300)),
            "nan": COLOR,
        },
    ),
    "images.draw_points": Call(
        cvkern.images.draw_points,
        {"image": colour, "points": rows(2)},
        {"radius": WIDTH, "color": COLOR},
    ),
    "images.draw_lines": Call(
        cvkern.images.draw_lines,
        {"image": colour, "segments": rows(4)},
        {"width": WIDTH, "color": COLOR},
    ),
    "images.draw_circles": Call(
        cvkern.images.draw_circles,
        {"image": colour, "circles": rows(3)},
        {"width": WIDTH, "color": COLOR},
    ),
    "images.draw_epipolar_lines": Call(
        cvkern.images.draw_epipolar_lines,
        {
            "image": colour,
            "F": one(np.array([[0, 0, 0], [0, 0, -1], [0, 1, 0.5]])),
            "points": rows(2),
        },
        {"width": WIDTH, "side": one(0, 1, 2)},
    ),
    "images.overlay_mask": Call(
        cvkern.images.overlay_mask,
        {"image": colour, "mask": mask},
        {"opacity": number(0, 1), "color": COLOR},
    ),
    "images.luma": Call(cvkern.images.luma, {"image": colour}, {"channel_axis": one(-1, 2, 0)}),
    "images.write_image": Call(
        written,
        {
            "image": one_of(image, colour, channels),
            "name": one("a.png", "a.tif", "a.bmp", "a.jpg", "a.gif", "a", "a.npy", "no/a.png", ""),
        },
        {},
    ),
    "images.read_image": Call(read, {"content": harmed}, {}),
}
