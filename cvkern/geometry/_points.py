"""Points of callers as float64 (x, y) on the host, where solvers are."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern import _arrays
from cvkern._checks import FLOAT32_MAX, as_items, check_beside, check_image
from cvkern._runtime import Runtime, runtime


def check_points(points: Any, name: str, columns: int = 2) -> Any:
    """Return `points` as an array of real numbers of shape (N, columns); N may be 0."""
    if not hasattr(points, "shape"):
        rows = as_items(points, name, f"points of {columns} numbers")
        if not rows:
            points = np.empty((0, columns))
        else:
            try:
                points = np.asarray(points)
            except ValueError as error:
                got = f"rows that differ: {error}"
                raise ValueError(f"{name} must be rectangular, got {got}") from None
    shape = tuple(points.shape)
    if len(shape) != 2 or shape[1] != columns:
        raise ValueError(f"{name} must have shape (N, {columns}), got {shape}")
    return check_image(points, name=name) if shape[0] else points


def check_pairs(
    points0: Any,
    points1: Any,
    columns: int = 2,
    names: tuple[str, str] = ("points0", "points1"),
) -> tuple[Any, Any]:
    """Return matched points of two images (or of a scene and an image), as many of the one."""
    points0 = check_points(points0, names[0], columns)
    points1 = check_points(points1, names[1])
    if len(points0) != len(points1):
        raise ValueError(
            f"{names[1]} must be as many as {names[0]}, {len(points0)}, got {len(points1)}"
        )
    return points0, points1


def on_host(rt: Runtime, array: Any) -> np.ndarray:
    """Return an array of any library as float64 of the host."""
    if rt.device == "cpu" or isinstance(array, np.ndarray) or not len(array):
        return np.asarray(array, np.float64)
    dtype = _arrays.library(array).dtype(array)
    wide = np.float64 if dtype == np.float64 else np.float32
    return rt.to_numpy(rt.adopt(array, wide)).astype(np.float64)


def all_on_host(rt: Runtime, arrays: list[Any]) -> list[np.ndarray]:
    """Return arrays (N, K) as :func:`on_host` does; those of a GPU come in one copy if they can."""
    filled = [a for a in arrays if len(a)]
    kinds = {(type(a), _arrays.library(a).dtype(a)) for a in filled}
    if rt.device == "cpu" or len(filled) < 2 or len(kinds) > 1 or isinstance(filled[0], np.ndarray):
        return [on_host(rt, a) for a in arrays]
    joined = _arrays.library(filled[0]).join(filled)
    if joined is None:
        return [on_host(rt, a) for a in arrays]
    return np.split(on_host(rt, joined), np.cumsum([len(a) for a in arrays])[:-1])


def xy(points: np.ndarray) -> np.ndarray:
    """Exchange row and column."""
    return np.ascontiguousarray(points[:, ::-1])


def finite_pairs(
    points0: Any, points1: Any, weights: Any, columns: int = 2
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return both lists as finite (x, y), and weights; those of weight 0 are left out."""
    points0, points1 = check_pairs(points0, points1, columns)
    weights = check_beside(weights, (len(points0),), "weights")
    rt = runtime(*(a for a in (points0, points1, weights) if a is not None))
    a, b = on_host(rt, points0), on_host(rt, points1)
    w = np.ones(len(a)) if weights is None else on_host(rt, weights)
    for values, name in ((a, "points0"), (b, "points1")):
        if not (np.abs(values) <= FLOAT32_MAX).all():
            raise ValueError(f"{name} must be finite in float32, got some that are not")
    wrong = w[~(np.isfinite(w) & (w >= 0))]
    if len(wrong):
        raise ValueError(f"weights must be >= 0 and finite, got {wrong[0]:g}")
    keep = w > 0
    a, b, w = a[keep], b[keep], w[keep]
    return (xy(a) if columns == 2 else a), xy(b), w
