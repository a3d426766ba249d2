"""Stacks of photographs, and thresholds estimated from them."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern._checks import check_image

_CARRIED = (np.dtype(np.uint8), np.dtype(np.uint16), np.dtype(np.float32))
_SAMPLED = 128  # pixels along a side of the grid for estimates of noise and thresholds


def stacked(images: Any) -> Any:
    """Return the images as one stack; a sequence of images is stacked."""
    if isinstance(images, (list, tuple)):
        if any(not isinstance(image, np.ndarray) for image in images):
            raise TypeError(
                "images must be one array of shape (K, H, W), or a list of NumPy arrays"
            )
        if len({image.shape for image in images}) > 1:
            shapes = sorted({image.shape for image in images})
            raise ValueError(f"images must have one shape, got {', '.join(map(str, shapes))}")
        images = np.stack(images) if images else np.zeros((0, 0, 0))
    return check_image(images, ndim=(3,), name="images")


def carried_as(dtype: np.dtype) -> np.dtype:
    """Return the dtype in which kernels read frames of the given dtype."""
    return dtype if dtype in _CARRIED else np.dtype(np.float32)


def grid_step(height: int, width: int) -> int:
    """Return the step of the pixel grid for estimates of noise and thresholds."""
    return max(1, min(height, width) // _SAMPLED)


def share_of_brightest(values: np.ndarray, quantile: float, share: float) -> float:
    """Return a share of a quantile of the finite values; 0 if there are none."""
    finite = np.sort(values[np.isfinite(values)], axis=None)
    return share * float(finite[int(quantile * (len(finite) - 1))]) if len(finite) else 0.0
