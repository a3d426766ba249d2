"""Small matrices on the host, as float64: those of callers, and nearest rotations."""

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


def check_camera(K: Any, name: str) -> np.ndarray:
    """Return a camera matrix that has an inverse, with a last element of 1 unless it is 0."""
    camera = check_matrix(K, (3, 3), name)
    if np.linalg.matrix_rank(camera) < 3:
        raise ValueError(f"{name} must have an inverse, got a matrix of rank below 3")
    return camera / camera[2, 2] if camera[2, 2] else camera


def check_cameras(K: Any, count: int, name: str) -> np.ndarray:
    """Return camera matrices (count, 3, 3), of one for all or of one each."""
    array = check_image(K, ndim=(2, 3), name=name)
    shape = tuple(array.shape)
    if len(shape) == 2:
        return np.broadcast_to(check_camera(array, name), (count, 3, 3))
    if shape != (count, 3, 3):
        raise ValueError(f"{name} must have shape (3, 3) or {(count, 3, 3)}, got {shape}")
    values = on_host(runtime(array), array)
    return np.stack([check_camera(values[i], f"{name}[{i}]") for i in range(count)])


def nearest_rotations(matrices: np.ndarray) -> np.ndarray:
    """Return the rotations (..., 3, 3) nearest to matrices, by the sum of squared differences."""
    u, _, vt = np.linalg.svd(matrices)
    mirrored = np.linalg.det(u @ vt) < 0
    u[..., 2] *= np.where(mirrored, -1.0, 1.0)[..., None]
    return u @ vt
