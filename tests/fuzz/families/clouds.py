"""Point clouds: their films and files."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import cvkern.clouds
from tests.fuzz.arguments import Call, Draw, alike, image, maybe, number, one


def cloud(draw: Draw) -> Any:
    """Return points before a camera, some behind it, some nowhere."""
    found = draw.rng.normal(0, 1, (int(alike(draw).pick([0, 1, 2, 30, 30])), 3)) + np.array(
        [0, 0, 4]
    )
    found *= draw.pick([1, 1, 1e-20, 1e20])
    if draw.odd(0.1) and len(found):
        found[0, 0] = draw.pick([np.nan, np.inf])
    return found.astype(draw.pick(["f4", "f8"]))


def colors(draw: Draw) -> Any:
    """Return as many colours as points, mostly."""
    count = int(alike(draw).pick([0, 1, 2, 30, 30])) if draw.odd(0.9) else 3
    return draw.rng.integers(0, 256, (count, 3)).astype(np.uint8)


def film(draw: Draw) -> Any:
    """Return frames."""
    shape = (int(draw.pick([1, 2])), *(min(n, 20) for n in draw.shape), 3)
    if draw.odd(0.3):
        return image(draw, shape)
    return draw.rng.integers(0, 256, shape).astype(np.uint8)


def ply(points: Any, colors: Any = None) -> bytes:
    """Return the file that points make."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.ply"
        cvkern.clouds.write_ply(path, points, colors)
        return path.read_bytes()


def read(path: bytes) -> Any:
    """Read a file of any content; return its points and colours."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "a.ply"
        try:
            file.write_bytes(path)
        except TypeError:
            raise TypeError("path") from None
        return tuple(part for part in cvkern.clouds.read_ply(file) if part is not None)


def harmed(draw: Draw) -> bytes:
    """Return a file of points, a few of whose bytes are others, or that is cut short."""
    content = bytearray(ply(draw.rng.normal(0, 1, (4, 3)), np.zeros((4, 3), np.uint8)))
    for _ in range(int(draw.pick([0, 1, 1, 4]))):
        content[draw.rng.integers(len(content))] = draw.rng.integers(256)
    return bytes(content[: len(content) - int(draw.pick([0, 0, 1, 100]))])


def animation(frames: Any, fps: Any = 20.0) -> int:
    """Return how many bytes a film has."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.gif"
        cvkern.clouds.write_animation(path, frames, fps=fps)
        return len(path.read_bytes())


CALLS: dict[str, Call] = {
    "clouds.turntable": Call(
        cvkern.clouds.turntable,
        {"points": cloud, "colors": colors, "shape": one((9, 12), (1, 1), (20, 3), (0, 4))},
        {
            "frames": one(1, 2, 3),
            "swing": number(1, 180),
            "point_size": maybe(number(0.1, 9)),
            "background": one((16, 17, 20), (0, 0), (300, 0, 0)),
        },
    ),
    "clouds.read_ply": Call(read, {"path": harmed}, {}),
    "clouds.write_ply": Call(ply, {"points": cloud}, {"colors": colors}),
    "clouds.write_animation": Call(animation, {"frames": film}, {"fps": one(20.0, 1, 0, 1e9)}),
}
