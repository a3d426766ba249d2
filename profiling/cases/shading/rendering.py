"""Images of matt surfaces."""

from __future__ import annotations

from typing import Any

import numpy as np

import cvkern
from profiling.case import Case, Shape, Work

LIGHTS = np.array([[0.3, -0.2, 0.9], [-0.5, 0.1, 0.8], [0.1, 0.6, 0.7], [0.0, 0.0, 1.0]])


def _normals(shape: Shape, rng: np.random.Generator) -> np.ndarray:
    n = rng.normal(size=(*shape, 3)) + np.array([0, 0, 2])
    return (n / np.linalg.norm(n, axis=-1, keepdims=True)).astype(np.float32)


def _render(normals: Any) -> Any:
    return cvkern.lambertian(normals, LIGHTS)


def _oracle(normals: np.ndarray) -> np.ndarray:
    return np.maximum(np.einsum("yxc,kc->kyx", normals.astype(np.float64), LIGHTS), 0)


def most_apart(answer: Any, right: Any) -> float:
    """Return the largest difference."""
    return float(np.max(np.abs(answer[0].astype(np.float64) - right[0])))


CASES = (
    Case(
        name="lambertian",
        title="A matt surface under four lights, float32",
        image=_normals,
        call=_render,
        oracle=_oracle,
        oracle_name="NumPy in float64",
        difference=most_apart,
        tolerance=3e-7,  # three products and sums of float32, of numbers up to 1
        bytes_per_pixel=12 + 4 * 4,
        operations_per_pixel=4 * 7,
        work=Work("pixels", lambda normals: normals.shape[0] * normals.shape[1]),
        sizes=("1080p",),
        margin=0,
    ),
)
