"""Photographs in which keypoints are found: their checks, their grey values, their masks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cvkern._arrays import library
from cvkern._checks import check_image, check_integer
from cvkern._notices import may_look, warn
from cvkern._runtime import Runtime


def check_photograph(
    image: Any, mask: Any, max_keypoints: int | None, name: str = "image"
) -> tuple[Any, Any, int | None]:
    """Check a photograph, the mask of its points, and their number."""
    image = check_image(image, ndim=(2, 3), name=name)
    shape = tuple(image.shape)
    if len(shape) == 3 and shape[2] not in (3, 4):
        raise ValueError(f"{name} must have 3 or 4 channels, got shape {shape}")
    if mask is not None:
        mask = check_image(mask, name="mask")
        if tuple(mask.shape) != shape[:2]:
            raise ValueError(f"mask must have shape {shape[:2]}, got {tuple(mask.shape)}")
    if max_keypoints is not None:
        max_keypoints = check_integer(max_keypoints, "max_keypoints", 0, 2**26)
    return image, mask, max_keypoints


def warn_of_dark(rt: Runtime, image: Any, white: float) -> None:
    """Warn that an image has no keypoints if it is far darker than white."""
    if not may_look(rt):
        return
    values = as_host(rt, image)
    low, high = (float(f.reduce(values, axis=None)) for f in (np.fmin, np.fmax))
    if low < high <= white / 8:
        warn(f"no keypoint was found: the largest value is {high:.4g}, and white is {white:.4g}: "
             "give data_range")  # fmt: skip


def dtype_of_most(dtypes: Sequence[np.dtype]) -> np.dtype:
    """Return the dtype that most images have, of equally many the widest."""
    return max(dtypes, key=lambda dtype: (dtypes.count(dtype), dtype.itemsize))


def converted(image: np.ndarray, white: float, dtype: np.dtype, wanted: float) -> np.ndarray:
    """Return an image with the given white as one of another dtype and with the wanted white."""
    values = image * (wanted / white)
    if dtype.kind == "u":
        values = np.nan_to_num(values).clip(0, np.iinfo(dtype).max).round()
    return values.astype(dtype)


def as_host(rt: Runtime, array: Any) -> np.ndarray:
    """Bring an array of any library to the host, with its dtype."""
    if isinstance(array, (np.ndarray, list, tuple)):
        return np.asarray(array)
    return np.asarray(rt.to_numpy(rt.adopt(array, library(array).dtype(array))))


def prepared(rt: Runtime, image: Any, white: float, gray: Any = None) -> Any:
    """Return the grey of an image in parts of white, as a kernel array; fill `gray` if given."""
    shape = tuple(image.shape)
    if gray is None:
        gray = rt.scratch("features.gray", shape[:2])
    src = adopted(rt, image)
    rt.features.keypoints.extrema.prepare(src, float(np.float32(1.0 / white)), gray)
    return gray


def adopted(rt: Runtime, image: Any) -> Any:
    """Return a photograph (H, W) or (H, W, C) as a kernel array (H, W, C): bytes stay bytes."""
    shape = tuple(image.shape)
    byte = library(image).dtype(image) == np.uint8
    return rt.adopt(
        image,
        np.uint8 if byte else np.float32,
        shape=(*shape[:2], shape[2] if len(shape) == 3 else 1),
    )


def unmasked(points: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Return the indices of points (N, 2) whose nearest pixel of a mask on the host is not 0."""
    near = np.floor(points.astype(np.float64) + 0.5).astype(np.int64)
    row, column = (near[:, i].clip(0, mask.shape[i] - 1) for i in (0, 1))
    return np.flatnonzero(mask[row, column])
