"""Calls that compile the kernels of filters."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from cvkern.app.warmup import pictures
from cvkern.filters import (
    box,
    correlate_separable,
    gaussian,
    gradient,
    laplace,
    median,
    prewitt,
    scharr,
    sobel,
    sobel_h,
    sobel_v,
    threshold_otsu,
)


def calls() -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield a name and a call for every function, and for every dtype with its own kernels."""
    byte, real, color = pictures()
    taps = (0.25, 0.5, 0.25)
    for image, axis in ((real, None), (byte, None), (color, -1)):
        yield "gaussian", partial(gaussian, image, channel_axis=axis)
        yield "box", partial(box, image, channel_axis=axis)
        yield "correlate_separable", partial(correlate_separable, image, taps, channel_axis=axis)
    yield "gaussian", partial(gaussian, byte, dtype="uint8")
    yield "gaussian", partial(gaussian, byte.astype(np.uint16), dtype="uint16")
    for operator in ("gaussian", "sobel", "scharr"):
        yield "gradient", partial(gradient, real, operator=operator)
    yield "gradient", partial(gradient, color)
    yield "sobel", partial(sobel, real)
    yield "scharr", partial(scharr, real)
    yield "prewitt", partial(prewitt, real)
    for operator in (laplace, sobel_h, sobel_v):
        yield operator.__name__, partial(operator, real, mask=real > 0)
    yield "threshold_otsu", partial(threshold_otsu, byte)
    for dtype in (np.uint8, np.uint16, np.float32):
        for radius in (1, 2, 3):
            yield "median", partial(median, real.astype(dtype), radius)
