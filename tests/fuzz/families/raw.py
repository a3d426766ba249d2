"""Raw pictures and exposures."""

from __future__ import annotations

from typing import Any

import numpy as np

import cvkern
from tests.fuzz.arguments import Call, Draw, Maker, alike, channels, image, maybe, number, one

PATTERN = one("RGGB", "BGGR", "GRBG", "GBRG", "RGGB", "RGBG")
METHOD = one("bilinear", "malvar", "menon", "residual", "none")
DEVELOPED: dict[str, Maker] = {
    "pattern": PATTERN,
    "black": number(0, 64),
    "white": maybe(number(0.1, 255)),
    "illuminant": maybe(one((1, 1, 1), (0.4, 1, 0.5), (0, 1, 1), (1, 1))),
    "highlights": one("rebuild", "clip", "none"),
    "method": METHOD,
    "matrix": maybe(lambda draw: draw.rng.normal(size=(3, 3))),
    "tone": maybe(one("reinhard", "reinhard_local", "bilateral", "local_laplacian", "none")),
    "dtype": one("uint8", "float32", "uint16", "float64"),
}


def exposures(draw: Draw) -> Any:
    """Return images of one scene, two or more of them, and mostly bytes."""
    shape = (_count(draw), *draw.shape, *((3,) if draw.odd(0.4) else ()))
    if draw.odd(0.4):
        return image(draw, shape)
    return draw.rng.integers(0, 256, shape).astype(np.uint8)


def seconds(draw: Draw) -> Any:
    """Return times of the exposures."""
    if draw.odd(0.2):
        return draw.pick([(1,), (1, 1), (0, 1), (1e-30, 1e30), (1e-300, 1e300)])
    return [0.5 * 2.0**n for n in range(_count(draw))][:: draw.pick([1, -1])]


def _count(draw: Draw) -> int:
    """Return how many exposures a call has."""
    return int(alike(draw).pick([2, 3, 3, 1, 9]))


def colors(draw: Draw) -> Any:
    """Return rows of colours."""
    return draw.rng.random((24, 3)) * draw.pick([1, 1e-20, 1e20])


CALLS: dict[str, Call] = {
    "align_exposures": Call(
        cvkern.align_exposures, {"images": exposures}, {"reach": one(1, 8, 64, 0)}
    ),
    "demosaic": Call(cvkern.demosaic, {"raw": image}, {"pattern": PATTERN, "method": METHOD}),
    "develop": Call(cvkern.develop, {"raw": image}, DEVELOPED),
    "estimate_response": Call(
        cvkern.estimate_response,
        {"images": exposures, "seconds": seconds},
        {"method": one("debevec", "robertson", "none")},
    ),
    "fit_color_matrix": Call(cvkern.fit_color_matrix, {"measured": colors, "wanted": colors}, {}),
    "fuse_exposures": Call(
        cvkern.fuse_exposures,
        {"images": exposures},
        {
            "contrast": number(0, 2),
            "saturation": number(0, 2),
            "exposure": number(0, 2),
            "white": maybe(number(0.1, 70000)),
        },
    ),
    "merge_exposures": Call(
        cvkern.merge_exposures,
        {"images": exposures, "seconds": seconds},
        {
            "response": maybe(one(np.linspace(-5, 5, 256), np.zeros((256, 3)), np.zeros(3))),
            "deghost": maybe(number(0, 9)),
        },
    ),
    "mosaic": Call(cvkern.mosaic, {"image": channels}, {"pattern": PATTERN}),
    "tone_map": Call(
        cvkern.tone_map,
        {"radiance": lambda draw: (image if draw.odd(0.5) else channels)(draw)},
        {
            "method": one("reinhard", "reinhard_local", "bilateral", "local_laplacian", "none"),
            "key": number(0.01, 2),
            "contrast": number(1, 20),
        },
    ),
}
