"""Calls that compile the kernels of raw pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from cvkern.raw import demosaic, mosaic
from cvkern.raw.demosaicing import METHODS


def calls() -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield a name and a call for every function and every dtype that has own kernels."""
    yield "mosaic", partial(mosaic, np.zeros((6, 8, 3), np.uint8))
    for dtype in (np.uint8, np.uint16, np.float32):
        for method in METHODS:
            yield "demosaic", partial(demosaic, np.zeros((6, 8), dtype), method=method)
