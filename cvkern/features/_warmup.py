"""Calls that compile the kernels of features."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from cvkern.features import (
    corner_harris,
    corner_peaks,
    corner_shi_tomasi,
    corner_subpix,
    match_descriptors,
    match_images,
    orb,
    sift,
)


def calls() -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield a name and a call for every function and every dtype that has own kernels."""
    y, x = np.mgrid[:48, :64].astype(np.float32)
    blob = np.exp(-((y - 24) ** 2 + (x - 30) ** 2) / 32.0)
    yield "corner_harris", partial(corner_harris, blob)
    yield "corner_shi_tomasi", partial(corner_shi_tomasi, blob)
    yield "corner_peaks", partial(corner_peaks, blob)
    yield "corner_subpix", partial(corner_subpix, blob, [(24, 30)])
    square = np.zeros((80, 90), np.float32)
    square[30:50, 35:60] = 1
    yield "orb", partial(orb, square)
    for dtype in (np.float32, np.uint8):
        yield "sift", partial(sift, (200 * blob).astype(dtype), data_range=200)
    numbers = np.random.default_rng(0).integers(0, 256, (20, 32)).astype(np.uint8)
    for metric in ("euclidean", "hamming"):
        yield "match_descriptors", partial(match_descriptors, numbers, numbers, metric=metric)
    yield "match_images", partial(match_images, [numbers, numbers])
