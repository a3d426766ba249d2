"""Masks of surfaces."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern._checks import check_image
from cvkern._runtime import Runtime
from cvkern._tape import capturing

EMPTY = "mask must not be 0 everywhere, got such a mask"


def check_shape(mask: Any, shape: tuple[int, ...]) -> Any:
    """Return a mask as an array of the given shape."""
    mask = check_image(mask, name="mask")
    if tuple(mask.shape) != shape:
        raise ValueError(f"mask must have shape {shape}, got {tuple(mask.shape)}")
    return mask


def host_mask(mask: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Return a mask on the host, True on the surface; it must not be 0 everywhere."""
    inside = np.asarray(check_shape(mask, shape)) != 0
    if not inside.any():
        raise ValueError(EMPTY)
    return inside


def kernel_mask(rt: Runtime, mask: Any, shape: tuple[int, ...], *, empty: bool = False) -> Any:
    """Return a mask for kernels, uint8, or the empty array, which means all pixels.

    Only with `empty` may it be 0 everywhere; a captured call does not check this.
    """
    if mask is None:
        return rt.scratch("shading.everywhere", (0, 1), np.uint8)
    inside = rt.adopt_mask(check_shape(mask, shape))
    if not (empty or capturing() or rt.to_numpy(inside).any()):
        raise ValueError(EMPTY)
    return inside
