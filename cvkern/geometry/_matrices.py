"""Small matrices of callers, as float64 on the host."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern._checks import FLOAT32_MAX, check_image
from cvkern._runtime import runtime
from cvkern.geometry._points import on_host


def check_matrix(matrix: Any, shape: tuple[int, ...], name: str) -> np.ndarray:
    """Return a finite matrix of `shape`, where -1 stands for any number."""
    array = check_image(matrix, ndim=(len(shape),), name=name)
    got = tuple(array.shape)
    if any(want not in (-1, have) for want, have in zip(shape, got, strict=True)):
        wanted = ", ".join("N" if want < 0 else str(want) for want in shape)
        raise ValueError(f"{name} must have shape ({wanted}), got {got}")
    values = on_host(runtime(array), array)
    if not (np.abs(values) <= FLOAT32_MAX).all():
        raise ValueError(f"{name} must be finite in float32, got one that is not")
    return values
