"""Corners, keypoints, descriptors, and their matches."""

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
    alike,
    channels,
    image,
    mask,
    maybe,
    number,
    one,
    one_of,
    points,
    whole,
)

PICTURE = one_of(image, image, channels)
SHARED: dict[str, Maker] = {
    "max_keypoints": maybe(whole(0, 60)),
    "mask": maybe(mask),
    "spread": one(False, True),
    "upright": one(False, True),
    "data_range": maybe(number(1, 300)),
}


def descriptors(draw: Draw) -> Any:
    """Return a few descriptors of bytes or numbers, some of them equal."""
    same = alike(draw)
    count, length = int(draw.pick([0, 1, 2, 9, 33])), int(same.pick([32, 32, 64, 128]))
    found = draw.rng.integers(0, same.pick([2, 256]), (count, length)).astype(np.uint8)
    return found.astype(same.pick(["uint8", "uint8", "uint8", "float32"]))


def lists(draw: Draw) -> list[Any]:
    """Return descriptors of several images, of one length and dtype."""
    dtype = draw.pick(["uint8", "float32"])
    counts = draw.rng.integers(0, 20, int(draw.rng.integers(1, 4)))
    return [draw.rng.integers(0, 9, (int(n), 32)).astype(dtype) for n in counts]


MATCH: dict[str, Maker] = {
    "max_ratio": number(0.1, 1),
    "cross_check": one(True, False),
    "metric": one("euclidean", "hamming", "cosine"),
}
CALLS: dict[str, Call] = {
    "corner_harris": Call(
        cvkern.corner_harris,
        IMAGE,
        {
            **BORDER,
            "method": one("k", "eps"),
            "k": number(0, 0.2),
            "eps": number(1e-9, 1),
            "sigma": number(0.1, 3),
        },
    ),
    "corner_shi_tomasi": Call(cvkern.corner_shi_tomasi, IMAGE, {**BORDER, "sigma": number(0.1, 3)}),
    "corner_peaks": Call(
        cvkern.corner_peaks,
        IMAGE,
        {
            "min_distance": whole(0, 9),
            "threshold_abs": maybe(number(0, 99)),
            "threshold_rel": maybe(number(0, 1)),
            "exclude_border": one(True, False, 0, 3),
            "num_peaks": maybe(whole(0, 9)),
        },
    ),
    "corner_subpix": Call(
        cvkern.corner_subpix,
        {**IMAGE, "corners": points},
        {"window_size": one(3, 5, 11, 4), "alpha": number(0.6, 0.99)},
        equal=False,
    ),
    "sift": Call(
        cvkern.sift,
        {"image": PICTURE},
        {
            **SHARED,
            "root": one(True, False),
            "double": one(True, False),
            "levels": one(3, 1, 5),
            "contrast_threshold": number(0, 0.1),
            "edge_threshold": number(1, 20),
            "sigma": number(0.9, 3),
        },
    ),
    "orb": Call(
        cvkern.orb,
        {"image": PICTURE},
        {
            **SHARED,
            "levels": whole(1, 8),
            "downscale": number(1.05, 3),
            "fast_threshold": number(0, 0.3),
        },
    ),
    "match_descriptors": Call(
        cvkern.match_descriptors, {"a": descriptors, "b": descriptors}, MATCH
    ),
    "match_images": Call(
        cvkern.match_images,
        {"features": lists},
        {**MATCH, "pairs": one(None, [(0, 1)], [(1, 0), (0, 2)], [(0, 0)], [])},
    ),
}
