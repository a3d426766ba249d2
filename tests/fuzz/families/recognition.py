"""Codebooks, and shape models of small pictures."""

from __future__ import annotations

from typing import Any

import numpy as np

import cvkern
from tests.fuzz.arguments import (
    Call,
    Draw,
    Maker,
    colour,
    image,
    maybe,
    number,
    one,
    several,
    whole,
)


def patches(draw: Draw) -> Any:
    """Return a list of patches, some of them alike, or any array."""
    if draw.odd(0.1):
        return image(draw)
    side, count = int(draw.pick([8, 8, 12, 25, 7])), int(draw.pick([1, 2, 30]))
    found = draw.rng.random((count, side, side))
    found[count // 2 :] = 1 - 0.9 * found[: count - count // 2]
    return found.astype(draw.pick(["float32", "float64"]))


def objects(draw: Draw) -> Any:
    """Return pictures of one object each, or any pictures."""
    if draw.odd(0.2):
        return several(image if draw.odd(0.7) else colour, 0, 3)(draw)
    coarse = np.kron(draw.rng.random((4, 5)), np.ones((5, 5)))
    return [coarse, np.roll(coarse, 1, 0)]


def recognise(
    images: Any,
    image: Any,
    boxes: Any = None,
    negatives: Any = None,
    points: Any = "grid",
    scales: Any = (1.0,),
    threshold: Any = None,
    patch: Any = 8,
    **options: Any,
) -> Any:
    """Fit a model, and find objects by it."""
    model = cvkern.ShapeModel(20, patch=patch, points=points, **options).fit(
        images, boxes, negatives=negatives
    )
    return model.detect(image, scales=scales, threshold=threshold)


def boxes(draw: Draw) -> Any:
    """Return boxes of two pictures."""
    return [[[0, 0, 16, 20]], draw.pick([[[2, 3, 20, 25]], [], [[0, 0, 99, 99]]])]


RANGE: dict[str, Maker] = {"data_range": maybe(number(0.5, 300))}
CALLS: dict[str, Call] = {
    "learn_codebook": Call(
        cvkern.learn_codebook,
        {"patches": patches},
        {
            **RANGE,
            "words": maybe(whole(1, 40)),
            "method": one("auto", "agglomerative", "kmeans"),
            "threshold": number(0.1, 1.0),
        },
    ),
    "ShapeModel": Call(
        recognise,
        {"images": objects, "image": image},
        {
            "boxes": boxes,
            "negatives": several(image, 0, 2),
            "points": one("grid", "harris", "dog"),
            "scales": one((1.0,), (0.7, 1.0), (0.0,), (99.0,)),
            "threshold": number(-5, 50),
            "patch": one(8, 5, 16),
            "step": whole(1, 5),
            "method": one("agglomerative", "kmeans", "none"),
            "correlation": number(0.1, 1),
            "max_words": whole(0, 3),
            "layers": whole(1, 3),
            "mirror": one(False, True),
        },
    ),
}
