"""Images of 8 and 16 bits, read and returned without a copy to floats by the caller's library."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern._arrays import library
from cvkern._runtime import Runtime

DEPTHS = (np.dtype(np.uint8), np.dtype(np.uint16))
RESULTS = ("float32", "uint8", "uint16")


def as_floats(rt: Runtime, image: Any, shape: Any = None) -> Any:
    """View an image as float32 for kernels; integers of 8 and 16 bits are converted by a kernel.

    The floats are valid until this thread asks for others.
    """
    dtype = library(image).dtype(image)
    if dtype not in DEPTHS:
        return rt.adopt(image, shape=shape)
    shape = tuple(shape or image.shape)
    floats = rt.scratch("depths.floats", shape)
    rt.filters.depths.widen(rt.adopt(image, dtype, shape), floats)
    return floats


def check_result(dtype: Any) -> np.dtype:
    """Return the dtype of a result."""
    try:
        given = np.dtype("float32" if dtype is None else dtype)
    except Exception:  # NumPy says of some that they are out of use
        given = None
    if given is None or given.name not in RESULTS:
        raise ValueError(f"dtype must be one of {RESULTS}, got {dtype!r}")
    return given
