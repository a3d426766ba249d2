"""Calls that compile the kernels of panoramas."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from cvkern.panorama import match_photographs, recognize_panoramas, stitch


def calls() -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield a name and a call for every function and every dtype that has own kernels."""
    y, x = np.mgrid[:96, :180]
    rng = np.random.default_rng(0)
    wide = np.zeros(y.shape)
    for size in rng.uniform(2, 6, 160):
        row, column = rng.uniform(0, (96, 180))
        wide += np.exp(-((y - row) ** 2 + (x - column) ** 2) / size**2)
    wide = np.asarray(200 * wide / wide.max(), np.uint8)
    parts = [wide[:, :130], wide[:, 50:]]
    yield "recognize_panoramas", partial(recognize_panoramas, parts)
    yield "match_photographs", partial(match_photographs, *parts)
    for dtype in (np.uint8, np.float32):
        yield "stitch", partial(stitch, [p.astype(dtype) for p in parts], data_range=255, bands=2)
