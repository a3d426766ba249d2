"""Integers in the order of floats, as kernels return them."""

from __future__ import annotations

import numpy as np


def floats_of(keys: np.ndarray) -> np.ndarray:
    """Return the float32 numbers of int32 keys; the bits of negative ones are inverted."""
    return np.where(keys < 0, keys ^ 0x7FFFFFFF, keys).astype(np.int32).view(np.float32)
