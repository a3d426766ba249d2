"""Panoramas of small images."""

from __future__ import annotations

from typing import Any

import numpy as np

import cvkern
from tests.fuzz.arguments import Call, Draw, Maker, channels, image, maybe, number, one, several


def heap(draw: Draw) -> Any:
    """Return overlapping parts of one picture, or images that have nothing in common."""
    if draw.odd(0.5):
        return several(image if draw.odd(0.7) else channels, 0, 3)(draw)
    coarse = draw.rng.random((12, 22))
    wide = np.kron(coarse, np.ones((8, 8)))
    parts = [wide[:, :130], wide[:, 40:]]
    if draw.odd(0.3):
        parts = [np.repeat(part[..., None], 3, 2) for part in parts]
    return [(255 * part).astype(draw.pick(["uint8", "float32"])) for part in parts]


RANGE: dict[str, Maker] = {"data_range": maybe(number(0.5, 300))}
CALLS: dict[str, Call] = {
    "recognize_panoramas": Call(cvkern.recognize_panoramas, {"images": heap}, RANGE),
    "stitch": Call(
        cvkern.stitch,
        {"images": heap},
        {
            **RANGE,
            "surface": one("auto", "plane", "cylinder", "sphere", "none"),
            "scale": number(0.2, 2),
            "crop": one(False, True),
            "compensate": one(True, False),
            "bands": maybe(one(1, 3, 8, 0)),
            "focal_lengths": maybe(one(100, (100, 120), (0, 1))),
            "max_pixels": one(10**5, 99, 0),
        },
    ),
}
