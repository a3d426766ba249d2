"""Calls that compile the kernels of raw pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from cvkern.raw import (
    align_exposures,
    demosaic,
    develop,
    estimate_response,
    fuse_exposures,
    merge_exposures,
    mosaic,
    tone_map,
)
from cvkern.raw.demosaicing import METHODS
from cvkern.raw.tone import METHODS as TONES

# Functions that run on the host, or on kernels that the calls below compile.
NO_KERNELS = ("fit_color_matrix",)


def calls() -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield a name and a call for every function and every dtype that has own kernels."""
    yield "mosaic", partial(mosaic, np.zeros((6, 8, 3), np.uint8))
    for dtype in (np.uint8, np.uint16, np.float32):
        for method in METHODS:
            yield "demosaic", partial(demosaic, np.zeros((6, 8), dtype), method=method)
    stack = np.arange(2 * 40 * 40).reshape(2, 40, 40)
    for dtype in (np.uint8, np.uint16, np.float32):
        yield "merge_exposures", partial(merge_exposures, stack.astype(dtype), [1, 2], deghost=1)
    yield "estimate_response", partial(estimate_response, stack.astype(np.uint8), [1, 2])
    for dtype in (np.uint8, np.float32):
        yield "fuse_exposures", partial(fuse_exposures, stack.astype(dtype))
        colours = np.repeat(stack.astype(dtype)[..., None], 3, axis=3)
        yield "fuse_exposures", partial(fuse_exposures, colours)
    for dtype in (np.uint8, np.uint16, np.float32):
        yield "align_exposures", partial(align_exposures, stack.astype(dtype))
    for method in TONES:
        yield "tone_map", partial(tone_map, np.arange(48.0).reshape(6, 8), method)
    yield "develop", partial(develop, np.ones((6, 8)))
