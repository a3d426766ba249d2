"""Resampling: by coordinates, matrices and scales."""

from __future__ import annotations

from typing import Any

import numpy as np

import cvkern
from tests.fuzz.arguments import (
    BORDER,
    IMAGE,
    Call,
    Draw,
    Maker,
    channels,
    image,
    maybe,
    number,
    one,
    one_of,
    pair,
    whole,
)

MADE: dict[str, Maker] = {**BORDER, "order": one(0, 1, 3, 2), "dtype": one(None, "uint8", "f4")}
DEEP: dict[str, Maker] = {"image": channels, "channel_axis": one(-1, 2, 2, 0)}
LAYERS: dict[str, Maker] = {
    **BORDER,
    "max_layer": whole(-1, 5),
    "downscale": number(1.01, 4),
    "sigma": maybe(number(0, 3)),
}


def coordinates(draw: Draw) -> Any:
    """Return where to look, about the image and far from it."""
    height, width = draw.shape
    shape = (2, int(draw.pick([1, 3, 20])), int(draw.pick([1, 5, 33])))
    found = draw.rng.uniform(-2, 2, shape) + np.array([height, width])[:, None, None] / 2
    found *= draw.pick([1, 1, 2, 1e3, 1e9, 1e30])
    if draw.odd(0.1):
        found.reshape(-1)[0] = draw.pick([np.nan, np.inf, -np.inf])
    return found.astype(draw.pick(["float32", "float64"]))


def size(draw: Draw) -> Any:
    """Return a height and a width."""
    return tuple(int(n) for n in draw.rng.integers(1, 60, 2))


def matrix(draw: Draw) -> Any:
    """Return a homography: near the identity, or any."""
    found = np.eye(3) + draw.rng.normal(0, draw.pick([0, 1e-3, 0.3, 1e6]), (3, 3))
    return found * draw.pick([1, 1, -1, 1e-30, 1e200])


def corners(draw: Draw) -> Any:
    """Return four corners, which may cross or fall together."""
    height, width = draw.shape
    square = np.array([[0, 0], [0, width], [height, width], [height, 0]], float)
    return square + draw.rng.normal(0, draw.pick([0, 1, 100]), (4, 2))


def backward(draw: Draw) -> dict[str, Any]:
    """Return arguments of the gradient, whose shapes go together."""
    where = coordinates(draw)
    return {"grad": draw.rng.normal(size=where.shape[1:]), "coordinates": where}


def remap_gradient(image: Any, both: Any, **options: Any) -> Any:
    """Call the gradient of `remap`."""
    try:
        grad, where = both["grad"], both["coordinates"]
    except (TypeError, KeyError, IndexError):
        raise TypeError("both") from None
    return cvkern.remap_backward(grad, image, where, **options)


CALLS: dict[str, Call] = {
    "remap": Call(cvkern.remap, {**IMAGE, "coordinates": coordinates}, MADE),
    "remap of channels": Call(cvkern.remap, {**DEEP, "coordinates": coordinates}, MADE),
    "remap_backward": Call(
        remap_gradient,
        {**IMAGE, "both": backward},
        {"order": one(0, 1, 3), "mode": BORDER["mode"]},
        equal=False,
    ),
    "warp_perspective": Call(
        cvkern.warp_perspective,
        {"image": image, "matrix": matrix},
        {**MADE, "shape": maybe(size)},
    ),
    "warp_perspective of channels": Call(
        cvkern.warp_perspective, {**DEEP, "matrix": matrix}, {**MADE, "shape": maybe(size)}
    ),
    "rectify_plane": Call(
        cvkern.rectify_plane,
        {**IMAGE, "corners": corners, "size": size},
        MADE,
    ),
    "rotate": Call(
        cvkern.rotate,
        {**IMAGE, "angle": number(-400, 400)},
        {**MADE, "resize": one(False, True), "center": maybe(pair(number(-9, 99)))},
    ),
    "resize": Call(
        cvkern.resize,
        {**IMAGE, "shape": size},
        {
            "method": one("linear", "area", "cubic"),
            "antialias": one(True, False),
            "dtype": one(None, "uint8", "f4"),
        },
    ),
    "resize of channels": Call(
        cvkern.resize,
        {**DEEP, "shape": size},
        {
            "antialias": one(True, False),
            "method": one("linear", "area"),
            "dtype": one("float32", "uint8"),
        },
    ),
    "pyramid_gaussian": Call(
        cvkern.pyramid_gaussian,
        {"image": one_of(image, image, channels)},
        {**LAYERS, "channel_axis": one(None, -1, 0)},
    ),
    "pyramid_laplacian": Call(
        cvkern.pyramid_laplacian,
        {"image": one_of(image, image, channels)},
        {**LAYERS, "channel_axis": one(None, -1, 0)},
    ),
}
