"""Calls that make every kernel of a set compile."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

import cvkern
from cvkern.radiance import HashField, Scene, VoxelField, fit, make_scene

SHAPE = (24, 40)


def calls() -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield a name and a call for every public function and every dtype that has own kernels."""
    noise = np.random.default_rng(0).integers(0, 256, SHAPE)
    byte, real = noise.astype(np.uint8), noise.astype(np.float32)
    color = np.repeat(real[..., None], 3, axis=2)
    taps = (0.25, 0.5, 0.25)
    for image, axis in ((real, None), (byte, None), (color, -1)):
        yield "gaussian", partial(cvkern.gaussian, image, channel_axis=axis)
        yield "box", partial(cvkern.box, image, channel_axis=axis)
        yield (
            "correlate_separable",
            partial(cvkern.correlate_separable, image, taps, channel_axis=axis),
        )
    for operator in ("gaussian", "sobel", "scharr"):
        yield "gradient", partial(cvkern.gradient, real, operator=operator)
    yield "sobel", partial(cvkern.sobel, real)
    yield "scharr", partial(cvkern.scharr, real)
    for dtype in (np.uint8, np.uint16, np.float32):
        for radius in (1, 2, 3):
            yield "median", partial(cvkern.median, noise.astype(dtype), radius)
    for norm in ("l1", "l2"):
        yield "canny", partial(cvkern.canny, byte, 0, 50, 100, operator="sobel", norm=norm)
        yield "canny", partial(cvkern.canny, real, 1, 5, 10, norm=norm)
    yield "subpixel_edges", partial(cvkern.subpixel_edges, real, 1, 5, 10)
    yield "make_scene", _scene
    for field in (
        VoxelField(resolutions=(16, 32), shares=(0.3,), rays=64),
        HashField(table_bits=10, samples=2**12, rays=64, cells=32),
    ):
        yield "fit", partial(_train, field)


def _scene() -> Scene:
    return make_scene(train=2, test=1, size=16)


def _train(field: Any) -> None:
    """Train for as long as a grid takes to be made finer."""
    fit(_scene(), field, steps=18, background="learnt", progress=False)
