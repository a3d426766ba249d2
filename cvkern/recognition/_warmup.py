"""Calls that compile the kernels of recognition."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from cvkern.recognition import ShapeModel, learn_codebook


def _recognise() -> None:
    y, x = np.mgrid[:24, :24]
    ring = np.abs(np.hypot(y - 11.5, x - 11.5) - 7) < 2.5
    scene = np.zeros((40, 50))
    scene[9:33, 14:38] = ring
    model = ShapeModel(20, patch=8).fit([ring])
    model.detect(scene, scales=[1.0])


def calls() -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield a name and a call for every function that has own kernels."""
    patches = np.random.default_rng(0).random((20, 8, 8))
    for method in ("agglomerative", "kmeans"):
        yield "learn_codebook", partial(learn_codebook, patches, method=method)
    yield "ShapeModel", _recognise
