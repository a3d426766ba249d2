"""Calls that compile the kernels of transforms."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from cvkern.app.warmup import pictures
from cvkern.transform import (
    pyramid_gaussian,
    pyramid_laplacian,
    rectify_plane,
    remap,
    remap_backward,
    resize,
    rotate,
    warp_perspective,
)


def calls() -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield a name and a call for every function and every dtype that has own kernels."""
    byte, real, _ = pictures()
    places = np.zeros((2, 3, 4), np.float32)
    grad = np.zeros((3, 4), np.float32)
    for order in (0, 1, 3):
        for image in (byte, real):
            for dtype in (np.uint8, np.float32):
                yield "remap", partial(remap, image, places, order, dtype=dtype)
                yield (
                    "warp_perspective",
                    partial(warp_perspective, image, np.eye(3), order=order, dtype=dtype),
                )
        yield "remap_backward", partial(remap_backward, grad, real, places, order)
    for image in (byte, real):
        for dtype in (np.uint8, np.float32):
            yield "resize", partial(resize, image, (9, 11), dtype=dtype)
    yield "rotate", partial(rotate, real, 20)
    yield "rectify_plane", partial(rectify_plane, real, [(0, 0), (0, 9), (9, 9), (9, 0)], (5, 5))
    yield "pyramid_gaussian", partial(pyramid_gaussian, real, 1)
    yield "pyramid_laplacian", partial(pyramid_laplacian, real, 1)
