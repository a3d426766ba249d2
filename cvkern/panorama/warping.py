"""Projection of images onto the surface of a panorama."""

from __future__ import annotations

from typing import Any

import numpy as np

from cvkern._arrays import library
from cvkern._runtime import Runtime
from cvkern.panorama.registration import resized, to_small
from cvkern.panorama.surfaces import Canvas, with_lens


def draw(
    rt: Runtime,
    image: Any,
    camera: Any,
    gains: Any,
    columns: Any,
    rows: Any,
    values: Any,
    weights: Any,
) -> None:
    """Draw an image on a part of a surface. All but the image are kernel arrays."""
    byte = library(image).dtype(image) == np.uint8
    shape = (*image.shape[:2], image.shape[2] if len(image.shape) == 3 else 1)
    rt.panorama.warping.project(
        rt.adopt(image, np.uint8 if byte else np.float32, shape=shape), camera, columns, rows,
        gains, values, weights,
    )  # fmt: skip


def shrunk(
    image: Any, factors: np.ndarray, n: int, coarse: Canvas, canvas: Canvas
) -> tuple[Any, np.ndarray]:
    """Return an image reduced to about the resolution of the coarse canvas, and its camera."""
    finer = factors.mean() * _enlargement(canvas, n) * coarse.step / canvas.step
    if finer > 1.5:
        height, width = image.shape[:2]
        sides = max(1, round(height / finer)), max(1, round(width / finer))
        image = resized(image, sides)
        factors = factors * (sides[1] / width, sides[0] / height)
    # The length of a pixel is the mean of both sides': they differ by rounding alone.
    bend = canvas.bend / float(np.mean(factors)) ** 2
    return image, with_lens(to_small(factors) @ canvas.matrices[n], bend)


def _enlargement(canvas: Canvas, n: int) -> float:
    """Return the side of a canvas pixel in image pixels, in the middle of the image."""
    x, y = (int(v) for v in (canvas.rects[n, :2] + canvas.rects[n, 2:]) // 2)
    (a, b), (p, q) = canvas.columns(x, 2).T, canvas.rows(y, 2).T
    rays = np.array([[a[j] * p[i], q[i], b[j] * p[i]] for i, j in ((0, 0), (0, 1), (1, 0))])
    there = rays @ canvas.matrices[n].T
    places = there[:, :2] / there[:, 2:]
    area = abs(np.linalg.det(places[1:] - places[0]))
    return float(np.sqrt(area)) if np.isfinite(area) and area > 0 else 1.0
